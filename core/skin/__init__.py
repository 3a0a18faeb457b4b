"""Skin: the mesh of a fingertip, its linear elasticity, and the compliance of the nodes that may touch."""
