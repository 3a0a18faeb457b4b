"""Live streaming of command tracks to devices: a process of its own, protocols, transports, a virtual device.

presets/streaming_protocol.md describes the messages and the duties of a receiver, presets/streaming_safety.md the
rules for people.
"""
