"""Sweeps: resumable tables of results for variants of devices, materials, skins, methods and seeds."""
