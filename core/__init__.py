"""Dermis' engine: what skin would feel in an animated scene, and what a tactile device should do about it."""
