"""Skin that stiffens: what tissue does beyond linear skin, in a few patterns of its displacement."""
