"""Sound cards that drive an amplifier: chosen by name, measured by a cable from out to in, played to."""
