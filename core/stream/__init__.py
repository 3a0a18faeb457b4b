"""Live streaming of command tracks to devices.

The package contains the sender, a process of its own, with its protocols, its transports and a virtual device.

presets/streaming_protocol.md describes the messages and the duties of a receiver, presets/streaming_safety.md the
rules for people.
"""
