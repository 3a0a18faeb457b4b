"""The test of a real device before a finger goes in."""
