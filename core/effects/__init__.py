"""Effects of a tactor without a skin: transient, texture, weight, content, patterns; and reliefs under a screen."""
