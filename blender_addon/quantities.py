"""Lengths in scene units, and numbers with their unit as people read them."""

from __future__ import annotations

import bpy


def metres_per_unit(scene: bpy.types.Scene) -> float:
    """Return the length of one scene unit [m].

    Without a unit system it is one metre, whatever the scale is. Blender's scale is a float32, so it is rounded: 0.001
    is meant, not 0.0010000000474974513.
    """
    settings = scene.unit_settings
    return 1.0 if settings.system == "NONE" else float(f"{settings.scale_length:.7g}")


def length_text(metres: float) -> str:
    """Return a length for people with three digits: millimetres below a metre."""
    return f"{metres:.3g} m" if metres >= 1.0 else f"{1e3 * metres:.3g} mm"


def quantity(value: float, unit: str) -> str:
    """Return a number for people: millimetres below a metre, degrees for radians."""
    if unit == "m":
        return f"{value * 1e3:+.3f} mm"
    if unit == "rad":
        return f"{value * 57.29577951308232:+.2f}°"
    if unit == "V":
        return f"{value:.1f} V"
    if unit == "Hz":
        return f"{value:.0f} Hz"
    return f"{value:.4g} {unit}" if unit != "1" else f"{value:.4g}"
