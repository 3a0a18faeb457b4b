"""Measured fingers: what was done to people's fingertips, done to a skin."""
