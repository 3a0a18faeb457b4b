"""Matching: from what a finger touches to the commands that make a device feel most like it, one file per method."""

# Kinds of device whose method takes what the finger's whole skin feels.
SKIN_KINDS = frozenset({"pin_array", "thimble", "cable_platform", "hexapod"})
