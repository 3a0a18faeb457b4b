"""Dermis' tests: unit (no Blender), blender (bpy as a module), extension (the installed zip), benchmarks."""
