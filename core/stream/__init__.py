"""Live streaming of command tracks to devices: a process of its own, protocols, transports, a virtual device.

What is sent, when it is safe, and what a receiver must do stands in presets/streaming.md.
"""
