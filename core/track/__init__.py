"""Command tracks, their limits and their files."""
