"""Sound cards that drive an amplifier: choice, measurement, playback."""
