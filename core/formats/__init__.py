"""Views of a command track as files; each knows the format and nothing of scenes."""
