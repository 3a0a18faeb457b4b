"""Surfaces of things that are touched: distance, normals, mesh repair."""
