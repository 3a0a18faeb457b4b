"""A record of the stream: rows go from the sender through a ring to a process of their own, and from there to sinks.

The format stands in presets/stream_log.md.
"""
