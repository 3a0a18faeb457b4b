"""Armatures as nobody would make them: fingers are attached, or refused in words; nothing fails in between."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from .hand_rigs import makehuman, mixamo, nameless, unreal, webxr

NAMES = (unreal, mixamo, makehuman, webxr, nameless)
FINGERS = ("thumb", "index", "middle", "ring", "little")


@pytest.mark.shared_cases("seeds of armatures")
@pytest.mark.parametrize("seed", range(40))
def test_any_armature_is_taken_or_refused(seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = bpy.data.armatures.new("Armature")
    armature = bpy.data.objects.new("Armature", data)
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    name = NAMES[seed % len(NAMES)]
    flat = rng.random() < 0.2  # all in a plane, a line or a point
    shape = rng.choice([0.0, 1.0], size=3) if flat else np.ones(3)
    made: list[str] = []
    for finger in FINGERS:
        for place in range(1, int(rng.integers(1, 6))):
            called = name(finger, min(place, 4), str(rng.choice(["L", "R"]))) or f"Extra.{place}"
            bone = data.edit_bones.new(called)
            bone.head = rng.integers(-2, 3, size=3) * 0.02 * shape
            bone.tail = bone.head + type(bone.head)(rng.normal(size=3) * 0.03)
            bone.parent = data.edit_bones[str(rng.choice(made))] if made and rng.random() < 0.8 else None
            made.append(bone.name)
    bpy.ops.object.mode_set(mode="OBJECT")
    armature.scale = [(1.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (1.0, 3.0, 0.2), (50.0, 50.0, 50.0)][seed % 4]
    for posed in armature.pose.bones:
        posed.rotation_quaternion, posed.scale = rng.normal(size=4), rng.uniform(0.5, 2.0, size=3)
    bpy.context.view_layer.update()
    if rng.random() < 0.3 and data.bones:
        bpy.ops.object.mode_set(mode="POSE")
        data.bones.active = data.bones[int(rng.integers(len(data.bones)))]
    try:
        with np.errstate(divide="raise", invalid="raise"):
            bpy.ops.dermis.attach_fingers(hand=str(rng.choice(["AUTO", "BOTH"])))
    except RuntimeError as refused:
        assert "Traceback" not in str(refused), refused
        return
    bpy.context.view_layer.update()
    for obj in bpy.context.scene.objects:
        if obj.dermis.role == "FINGER":
            frame = np.array(obj.matrix_world)[:3, :3]
            assert np.isfinite(frame).all() and np.linalg.det(frame) == pytest.approx(1.0, abs=1e-2)
