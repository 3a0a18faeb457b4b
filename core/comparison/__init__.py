"""One touch, every device: which presets fit it, what each makes of it, and the report."""
