"""Effects of a tactor without a skin, and reliefs under a screen.

The effects of a tactor are contact transient, texture, weight, content and patterns.
"""
