"""Build the examples for skin.

One fingertip presses a sphere, an edge and a ribbed plate, and slides over them. Five fingers touch a thing each, all
at once. Two fingers of the same size, one of linear tissue and one of tissue that stiffens, press one block and slide
along it. Everything has its real size.
"""

from __future__ import annotations

import math

import bpy

from . import demo_stage
from .demo_shapes import block, ribbed_plate, ridge, rod, sphere
from .demo_stage import BLUE, GREEN, ROSE, STEEL, add, touchable

FPS = 24
NAME = "Dermis Skin Demo"
SPHERE_RADIUS, RIDGE_ANGLE = 6e-3, math.radians(100.0)
HEIGHT = 12e-3  # [m] height of the touched objects above the table's top, which is at 0
DEPTH = 1.1e-3  # [m] depth of the presses
RIBS = 6e-3  # [m] period of the ribs, long enough for points of the skin that slides over them to follow
SLIDE = 4e-3
# [m] The fingers of a hand have draft skins, so that they can be played. The objects that they touch have curvatures
# small enough for a draft's nodes. BALL, BAR: radii. WAVE: period and height.
BALL, BAR, WAVE = 18e-3, 18e-3, (16e-3, 0.3e-3)
TISSUES = {"Linear": "linear", "Neo-Hookean": "neo_hookean"}
DEEP, DRAG = 1.8e-3, 2e-3  # [m] DEEP: depth of the touch of the two tissues. DRAG: length of its slide


def build(fingers: int) -> bpy.types.Scene:
    """Return a new scene with one, two or five fingers.

    One finger touches three things in turn, two fingers have different tissues, and five fingers touch a thing each.
    """
    scene = demo_stage.begin(NAME, FPS, 145 if fingers == 1 else 73)
    if fingers == 1:
        _one(scene)
    elif fingers == 2:
        _tissues(scene)
        return demo_stage.finish(scene, (-0.05, 0.15, 0.08), (0.0, 0.0, 0.014))
    else:
        _five(scene)
        return demo_stage.finish(scene, (-0.07, 0.21, 0.112), (-0.006, 0.0, 0.014))  # the view includes the thumb
    return demo_stage.finish(scene, (-0.05, 0.15, 0.08), (0.0, 0.0, 0.011))


def _one(scene: bpy.types.Scene) -> None:
    _desk(scene, 0.13)
    spots = (0.034, 0.0, -0.034)  # from left to right as the view sees them
    touchable(add(scene, "Sphere", sphere(SPHERE_RADIUS), (spots[0], 0.0, HEIGHT - SPHERE_RADIUS), GREEN), 0.5)
    touchable(add(scene, "Edge", ridge(0.026, HEIGHT, RIDGE_ANGLE), (spots[1], 0.0, HEIGHT), BLUE), 0.5)
    touchable(add(scene, "Plate", ribbed_plate(0.026, 0.026, HEIGHT, RIBS), (spots[2], 0.0, HEIGHT), STEEL), 0.6)
    finger = demo_stage.finger_with_skin(scene, "Index", preset="index_medium", level="standard")
    rows: list[tuple[float, float, float, float]] = []
    for i, x in enumerate(spots):
        f, deep = 1 + 48 * i, HEIGHT - DEPTH
        slide = SLIDE if i < 2 else 1.5 * SLIDE
        rows += [
            (f, x - 0.5 * slide, 0.0, HEIGHT + 8e-3),
            (f + 10, x - 0.5 * slide, 0.0, deep),
            (f + 16, x - 0.5 * slide, 0.0, deep),
            (f + 32, x + 0.5 * slide, 0.0, deep),
            (f + 37, x + 0.5 * slide, 0.0, deep),
            (f + 46, x + 0.5 * slide, 0.0, HEIGHT + 8e-3),
        ]
    rows.append((145, spots[2], 0.0, HEIGHT + 8e-3))
    demo_stage.key(finger, "location", rows)


def _tissues(scene: bpy.types.Scene) -> None:
    _desk(scene, 0.09)
    touchable(add(scene, "Block", block(0.06, 0.03, HEIGHT), (0.0, 0.0, HEIGHT), STEEL), 0.6)
    for i, (name, tissue) in enumerate(TISSUES.items()):
        x = (0.5 - i) * 0.03  # from left to right as the view sees them
        finger = demo_stage.finger_with_skin(scene, name, preset="index_medium", level="standard")
        finger.dermis.finger.skin.tissue = tissue
        deep, high = HEIGHT - DEEP, HEIGHT + 8e-3
        rows = [(1, x, 0.0, high), (17, x, 0.0, deep), (29, x, 0.0, deep), (53, x, -DRAG, deep), (73, x, -DRAG, high)]
        demo_stage.key(finger, "location", rows)


def _five(scene: bpy.types.Scene) -> None:
    _desk(scene, 0.17)
    top = (0.0, HEIGHT)
    hand = (  # a finger, its preset and place along Y; its object, the object's offset, height and colour
        ("Thumb", "thumb_medium", -0.012, "Ball", sphere(BALL), (0.0, HEIGHT - BALL), GREEN),
        ("Index", "index_medium", 0.004, "Bar", rod(BAR, 0.020), top, BLUE),
        ("Middle", "index_large", 0.008, "Wave", ribbed_plate(0.020, 0.026, HEIGHT, *WAVE), top, STEEL),
        ("Ring", "index_medium", 0.003, "Block", block(0.020, 0.026, HEIGHT), top, STEEL),
        ("Little", "little_medium", -0.006, "Pad", block(0.020, 0.026, HEIGHT), top, ROSE),
    )
    for i, (name, preset, y, thing, data, (beside, high), colour) in enumerate(hand):
        x = 0.027 * (i - 2)
        touchable(add(scene, thing, data, (x + beside, y, high), colour), 0.6, soft=20.0 if thing == "Pad" else 0.0)
        finger = demo_stage.finger_with_skin(scene, name, preset=preset, level="draft")
        if thing == "Ball":  # too few nodes of a draft would touch the ball
            finger.dermis.finger.skin.level = "standard"
        deep, late = HEIGHT - DEPTH, 2 * i
        demo_stage.key(
            finger,
            "location",
            [
                (1, x, y - 2e-3, HEIGHT + 8e-3),
                (11 + late, x, y - 2e-3, deep),
                (26, x, y - 2e-3, deep),
                (46, x, y + 2e-3, deep),
                (54, x, y + 2e-3, deep),
                (64, x, y + 2e-3, HEIGHT + 8e-3),
                (73, x, y + 2e-3, HEIGHT + 8e-3),
            ],
        )


def _desk(scene: bpy.types.Scene, width: float) -> None:
    add(scene, "Desk", block(width, 0.07, 4e-3), colour=(0.20, 0.17, 0.15, 1.0))
