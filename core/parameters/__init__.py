"""Parameters: one row for each setting of a finger, a device on it, a material, a screen, a skin and a stream.

Everything else about a setting follows from its row: the property in Blender's window, what presets and scenes may
hold, the engine's values without them, and `core/PARAMETERS.md`. Search for a parameter's name to find its row
and its uses; switches of effects and devices are read as `{effect}_on` and `use_{effect}`. The rows are plain data;
kinds of device list theirs in `devices/kinds.py`.
"""
