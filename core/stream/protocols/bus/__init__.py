"""Smart servos on one half-duplex line, with a module for each maker."""
