"""Parameters: one row for each setting of scenes, skins and streams.

There are settings of a finger, a device on it, a material, a screen, a skin, a stream and a WAV file. Everything else
about a setting follows from its row: the property in Blender's window, the values that presets and scenes may state,
the engine's values if they do not state one, and `core/PARAMETERS.md`.

To find the row and the uses of a setting, search for its name. Names of switches are built by the code that reads
them: `{effect}_on` and `use_{effect}`. The rows are plain data. Those of a kind of device are in `devices/kinds.py`.
"""
