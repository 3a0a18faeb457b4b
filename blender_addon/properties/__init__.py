"""Settings of the artist, saved in the .blend."""
