"""Attach fingers to the bones of a hand: place, size and new objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from .. import fingertip_mesh
from .._core import DermisError, Finding, core
from ..preferences import library
from ..properties import skin_properties
from ..quantities import metres_per_unit
from . import armatures
from .bone_names import LEFT, RIGHT
from .fingertip_fit import Fit, fit
from .nails import Nails
from .rig import Rig, rotation
from .skeleton import Chain, Hand, ancestors, joints

# Presets for each finger; their lengths are scaled to the hand's.
_INDEX = ("index_small", "index_medium", "index_large")
PRESETS: Mapping[str, tuple[str, ...]] = {
    "thumb": ("thumb_small", "thumb_medium", "thumb_large"),
    "index": _INDEX,
    "middle": _INDEX,
    "ring": _INDEX,
    "little": ("little_medium",),
}
ON_SKIN = "on skin"
HUMAN = (0.25, 4.0)  # scales of presets in a person's hand; beyond these, the units may be wrong
POINTS = (0.5, 2.0)  # scales of presets for which points of the skin, 0.1 to 0.8 mm apart, are fine enough
_LENGTHS = core.parameters.skin.LENGTHS
_Values = Mapping[str, Any]  # of a skin preset, in SI


@dataclass(frozen=True)
class Tip:
    """One finger to be attached.

    Attributes:
        bone: name of the bone that carries it. flip: put the nail on the opposite side to the one found.
        width: width of the finger [m]; 0 for the width found from the hand.
    """

    finger: str
    bone: str
    flip: bool = False
    width: float = 0.0


def attach(
    context: bpy.types.Context, rig: Rig, hand: Hand, tips: Sequence[Tip], side: str
) -> tuple[list[bpy.types.Object], list[Finding], list[Fit]]:
    """Put fingers on bones; return the fingers, warnings, and their fits.

    Args:
        hand: the hand of the tips. If a tip is not on the last bone of a chain of the hand, its chain is made of the
            bones that carry it.
        side: side in the names of the fingers, 'L' or 'R'; '' for none.

    Raises:
        DermisError: a bone does not exist, or a finger's size is not one of a skin; nothing was made.
    """
    hand = replace(hand, chains={**hand.chains, **{tip.finger: _chain(rig, hand, tip) for tip in tips}})
    found, presets = rig.nails(hand), _presets()
    fits = [_fit(context, rig, hand.chains[tip.finger], tip, found, presets) for tip in tips]
    for tip, fitted in zip(tips, fits, strict=True):
        _judge(rig, tip, _scaled(presets[fitted.preset], fitted))
    made = []
    for tip, fitted in zip(tips, fits, strict=True):
        obj = _make(
            context, f"{tip.finger.title()}.{side}".rstrip("."), _scaled(presets[fitted.preset], fitted), fitted.preset
        )
        if not POINTS[0] < fitted.scale < POINTS[1]:
            obj.dermis.finger.skin.contact = "nodes"
        _hang(rig, obj, tip.bone, fitted)
        _collection(context, obj.parent).objects.link(obj)
        made.append(obj)
    return made, _doubts(rig, hand, found, tips, fits), fits


def misses(fitted: Fit) -> bool:
    """Return whether a pad is off the skin by over 1/10 of the finger's width."""
    return fitted.miss is not None and fitted.miss > fingertip_mesh.OFF * fitted.width


def told(fitted: Fit) -> str:
    """Return a text on the width of a finger, and whether its pad is on skin."""
    return f"{1e3 * fitted.width:.1f} mm wide, {where(fitted)}"


def where(fitted: Fit, *, short: bool = False) -> str:
    """Return a text on whether a pad lies on skin.

    Args:
        short: for the panel of the last operation, where a long text would be cut.
    """
    if fitted.miss is None:
        return "no skin" if short else "no skin found"
    if not misses(fitted):
        return ON_SKIN if short else "on the skin"
    return f"{1e3 * fitted.miss:.1f} mm off" + ("" if short else " the skin")


def _chain(rig: Rig, hand: Hand, tip: Tip) -> Chain:
    """Return the chain whose last bone carries a tip.

    Raises:
        DermisError: no such bone.
    """
    if tip.bone not in rig.places:
        raise DermisError(
            "there is no such bone",
            where=f"{rig.where}, {tip.finger} finger",
            value=tip.bone or "none",
            remedy="Choose the finger's last bone, or switch the finger off",
        )
    known = hand.chains.get(tip.finger)
    if known is not None and known.last == tip.bone:
        return known
    palm = ancestors(rig.bones, hand.wrist)
    own = [name for name in ancestors(rig.bones, tip.bone) if name not in palm][:3]
    return Chain(tuple(own[::-1]) or (tip.bone,))


def _fit(
    context: bpy.types.Context, rig: Rig, chain: Chain, tip: Tip, found: Nails, presets: Mapping[str, _Values]
) -> Fit:
    """Return the fit of a tip at rest."""
    nail = -found.directions[tip.finger] if tip.flip else found.directions[tip.finger]
    own = {key: presets[key] for key in PRESETS[tip.finger]}
    return fit(joints(rig.bones, chain), nail, rig.skin_of(chain), own, metres_per_unit(context.scene), tip.width)


def _presets() -> dict[str, _Values]:
    there = library()
    return {key: there.skin(key) for key in sorted({key for keys in PRESETS.values() for key in keys})}


def _scaled(preset: _Values, fitted: Fit) -> dict[str, Any]:
    """Return a preset's values with all lengths scaled by the same factor."""
    return {name: value * (fitted.scale if name in _LENGTHS else 1.0) for name, value in preset.items()}


def _judge(rig: Rig, tip: Tip, values: _Values) -> None:
    """Raise a `DermisError` for lengths that a skin cannot have."""
    for name, row in _LENGTHS.items():
        small = values[name] < row.low
        if small or values[name] > row.high:
            size, way = ("small", "up") if small else ("large", "down")
            unit = "1 for metres" if small else "0.001 for millimetres"
            raise DermisError(
                f"this fingertip is too {size} for a skin",
                where=f"{rig.where}, {tip.finger} finger",
                value=f"{row.label} {1e3 * values[name]:.3g} mm",
                limit=f"from {1e3 * row.low:g} to {1e3 * row.high:g} mm",
                remedy=f"Scale the armature {way}, or set the unit in Scene Properties > Units (Metric, Unit Scale "
                f"{unit})",
            )


def _make(context: bpy.types.Context, name: str, values: _Values, preset: str) -> bpy.types.Object:
    """Return a new finger whose fingertip has its skin's lengths.

    It is not linked to a collection yet.
    """
    data = fingertip_mesh.mesh(metres_per_unit(context.scene), fingertip_mesh.Lengths.of(values))
    obj = bpy.data.objects.new(name, data)
    obj.dermis.role = "FINGER"
    with fingertip_mesh.kept(data):
        skin_properties.apply_preset(obj.dermis.finger.skin, dict(values))
    obj.dermis.finger.skin.preset = preset
    return obj


def _hang(rig: Rig, obj: bpy.types.Object, bone: str, fitted: Fit) -> None:
    """Parent a finger to a bone, at the place that the bone's pose gives it.

    Its world scale is 1 for any scale of the armature.
    """
    moved = rig.move(bone)
    world = np.eye(4)
    world[:3, :3] = rotation(moved) @ fitted.axes
    world[:3, 3] = moved[:3, :3] @ fitted.origin + moved[:3, 3]
    armature, own = rig.places[bone]
    obj.parent = armature
    if own:
        obj.parent_type, obj.parent_bone = "BONE", own
    obj.matrix_parent_inverse = armatures.carrier(armature, own).inverted()
    obj.matrix_basis = Matrix(world.tolist())


def _collection(context: bpy.types.Context, armature: bpy.types.Object) -> bpy.types.Collection:
    """Return an editable collection of the scene with the armature in it.

    If there is none, return the active collection.
    """
    whole = context.scene.collection
    own = [c for c in (whole, *whole.children_recursive) if c.library is None and armature.name in c.objects]
    return own[0] if own else context.collection


def _doubts(rig: Rig, hand: Hand, found: Nails, tips: Sequence[Tip], fits: Sequence[Fit]) -> list[Finding]:
    """Return warnings about the fingers of a hand."""
    doubts = []

    def doubt(code: str, what: str, remedy: str, value: str | None = None) -> None:
        doubts.append(Finding("warning", code, what, rig.where, value, remedy=remedy))

    if not hand.named:
        doubt(
            "hand-unnamed",
            "the bones have no names of fingers, so their places tell which finger is which",
            "Compare the fingers with the hand. The panel of the last operation offers other readings",
        )
    bare = [tip.finger for tip, fitted in zip(tips, fits, strict=True) if not fitted.on_skin]
    if bare:
        doubt(
            "hand-without-skin",
            "some fingers have too little skin round their last bones, so their sizes and places follow from the bones",
            "Show the hand's mesh, and check that its vertex groups have the names of deforming bones",
            value=", ".join(bare),
        )
    off = [f"{tip.finger} {told(fitted)}" for tip, fitted in zip(tips, fits, strict=True) if misses(fitted)]
    if off:
        doubt(
            "pad-off-skin",
            "some pads do not lie on the skin of the hand",
            "Move these fingers onto the skin, or choose other bones in the panel of the last operation",
            value=", ".join(off),
        )
    if not found.sure:
        doubt(
            "nails-guessed",
            "neither names, bends, joint limits nor the thumb show the back of the hand, so left or right is a guess",
            "Check that the nails lie on the back of the hand. If not, choose the other hand in the panel of the last "
            "operation, or switch Flip on",
            value={LEFT: "left hand", RIGHT: "right hand"}.get(found.side),
        )
    elif hand.side and hand.side != found.side:
        side = "left" if hand.side == LEFT else "right"
        doubt(
            "hand-other-side",
            f"the hand is read as a {side} hand, but its bones lie and bend as those of the other hand",
            "Check the side of the hand",
        )
    scales = sorted((fitted.scale for fitted in fits), key=lambda scale: abs(np.log(scale)))
    if scales and not HUMAN[0] < scales[-1] < HUMAN[1]:
        doubt(
            "hand-scale",
            "the fingertips have no size of a person's",
            "Check the scene's units",
            value=f"{scales[-1]:.2g} times a person's",
        )
    return doubts
