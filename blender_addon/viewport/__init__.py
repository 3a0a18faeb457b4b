"""What the 3D view shows; only reads and draws."""
