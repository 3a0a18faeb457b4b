"""What a tactor shows without a skin: transient, texture, weight, content, patterns; and reliefs under a screen."""
