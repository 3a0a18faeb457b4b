"""Bakes, kept beside the .blend, and their files."""
