"""Smart servos on one half-duplex line: the common part, and one file for each maker's protocol."""
