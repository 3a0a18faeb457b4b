"""Matching: from a finger's touch to the commands that make a device feel most like it, one file per method."""
