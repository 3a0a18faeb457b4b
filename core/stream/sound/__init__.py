"""Sound cards that drive an amplifier: their choice, measurement and playback."""
