"""Matching: from what a finger touches to the commands that make a device feel most like it, one file per method."""
