"""Surrogates: learned models of a device pose's effect on skin or a sensor, and the direct model."""
