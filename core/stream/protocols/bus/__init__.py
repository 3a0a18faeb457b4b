"""Smart servos on one half-duplex line: a common part, and a module for each maker."""
