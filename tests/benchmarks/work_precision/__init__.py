"""Time a frame takes against how far its answer is off, knob by knob: `python build_addon.py bench --full`."""
