"""Tissue: the neo-Hookean law on a mesh, and what it makes of skin, worked out once for a shape."""
