"""Comparisons: one touch by all devices, touches with each other, and commands with earlier ones."""
