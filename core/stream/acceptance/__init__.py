"""The acceptance test of a built device, before a finger is put in."""
