"""One touch, every device: asked for in a panel, worked out by a child process."""
