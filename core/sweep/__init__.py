"""Sweeps: resumable tables of results for variants.

Devices, materials, skins, methods and seeds can vary.
"""
