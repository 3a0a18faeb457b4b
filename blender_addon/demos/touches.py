"""Titles and descriptions of the papers' touches for menus, by their keys."""

from __future__ import annotations

from collections.abc import Mapping

PLATFORM = "cable_platform"  # device for which the touches of the motors' examples are made

THIMBLE: Mapping[str, tuple[str, str]] = {
    "BALL": ("Ball", "A ball is pressed and rolled about the pad: the device's best case"),
    "EDGE": ("Edge", "An edge is pressed and turned: the device rounds it"),
    "BACK": ("Cylinder, Back", "A thin cylinder at the back of the pad"),
    "FRONT": ("Cylinder, Front", "A thin cylinder at the front of the pad"),
    "PRESS": ("Press", "The cylinder is pressed and let go"),
    "SLIDE": ("Slide", "The same cylinder slides along its axis: only friction differs from a press"),
    "PLATE": ("Sliding Plate", "A plate slides sideways and back: friction makes the disc roll"),
    "BLOCK": ("Shaken Block", "A block is held by two fingers and shaken up and down"),
    "CUP": ("Rim of a Cup", "The rim of a cup is pressed and turned: far from the device's abilities"),
    "FOAM": ("Foam", "A soft block is pressed and tilted"),
}
MOTORS: Mapping[str, tuple[str, str]] = {
    "flat": ("Flat", "The surface stays flat on the pad"),
    "back": ("Back, Flat, Back", "The surface rolls from the pad's back to flat and back again"),
    "tip": ("Tip, Flat, Tip", "The surface rolls from the fingertip to flat and back again"),
    "left": ("Left, Flat, Left", "The surface rolls from the pad's left side to flat and back again"),
    "right": ("Right, Flat, Right", "The surface rolls from the pad's right side to flat and back again"),
    "complex": ("Complex", "The surface rolls over several sides of the pad"),
}


def items(touches: Mapping[str, tuple[str, str]]) -> tuple[tuple[str, str, str], ...]:
    """Return touches as the items of a menu."""
    return tuple((key, *said) for key, said in touches.items())
