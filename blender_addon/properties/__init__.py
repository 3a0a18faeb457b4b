"""What the artist sets, saved in the .blend."""
