"""Comparisons of devices, of touches with each other, and of engines."""
