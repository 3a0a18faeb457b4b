"""Studies of the papers, repeated for any preset and stimulus."""
