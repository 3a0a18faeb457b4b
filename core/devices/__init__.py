"""Devices: one file per mechanism, each built from a preset."""
