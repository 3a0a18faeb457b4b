"""Protocols of devices, each in a module of its own."""
