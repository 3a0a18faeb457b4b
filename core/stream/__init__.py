"""Live streaming of command tracks to devices: a process of its own, protocols, transports, a virtual device.

presets/streaming.md describes the messages, the safety rules and the duties of a receiver.
"""
