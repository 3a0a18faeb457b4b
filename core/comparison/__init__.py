"""One touch, every device: the presets that fit it, their renderings, and the report."""
