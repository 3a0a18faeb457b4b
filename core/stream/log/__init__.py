"""The log of a stream.

The sender puts rows into a ring. Another process takes them out and writes them to files and tees. The file formats are
specified in presets/stream_log.md.
"""
