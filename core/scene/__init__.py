"""Sampled scenes: fingers, bodies and screens at every sample, and files."""
