"""What many instances cost over one joined mesh of the same, and what they take of memory.

10,000 boxes of 12 triangles lie in a square beside a finger, which comes down on the ones in the middle and slides over
them. They are shown by nodes, as one object's own surface. Measured is everything from Blender's scene to the tracks;
memory is what a process of its own holds at its most, as the system counts it.
"""

from __future__ import annotations

import functools
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from . import Result, benchmark, one_blas_thread

ROOT = Path(__file__).resolve().parents[2]
SIDE, FRAMES, TURNS = 100, 13, 3
SIZE, APART = 0.004, 0.01
"""[m] edge of a box, and from box to box."""
SCRIPT = "import os, sys; from tests.benchmarks import bench_instances as b; b.answer({!r})"
LAST = "; sys.stdout.flush(); os._exit(0)"  # the ordinary end of an interpreter with Blender may hang


class Taken(NamedTuple):
    """The least of the turns [s], the most memory [MB], and the largest force on a node [N]."""

    seconds: float
    megabytes: float
    force: float


@benchmark("instances_ratio", limit=2.0)
def instances_ratio() -> Result:
    """Sampling and bake of the instances over those of the joined mesh."""
    shown, joined = _taken("instances"), _taken("joined")
    wrong = None if shown.force == joined.force else f"{shown.force:g} N where the joined mesh gives {joined.force:g} N"
    peers = {"instances, s": shown.seconds, "joined, s": joined.seconds, "force, N": shown.force}
    return Result("instances_ratio", shown.seconds / joined.seconds, "1", None, peers, wrong)


@benchmark("instances_memory_ratio", limit=2.0)
def instances_memory_ratio() -> Result:
    """Peak of the resident memory of the whole process."""
    shown, joined = _taken("instances"), _taken("joined")
    peers = {"instances, MB": shown.megabytes, "joined, MB": joined.megabytes}
    return Result("instances_memory_ratio", shown.megabytes / joined.megabytes, "1", None, peers)


@benchmark("instance_bodies_s")
def instance_bodies() -> Result:
    """The same boxes as instances of a touchable object, each a body of its own."""
    bodies, joined = _taken("bodies"), _taken("joined")
    peers = {"joined, s": joined.seconds, "MB": bodies.megabytes, "joined, MB": joined.megabytes}
    return Result("instance_bodies_s", bodies.seconds, "s", None, peers)


@functools.cache
def _taken(kind: str) -> Taken:
    command = [sys.executable, "-c", SCRIPT.format(kind) + LAST]
    done = subprocess.run(command, cwd=ROOT, env=os.environ, capture_output=True, text=True, timeout=1800)
    answers = [line.split()[1:] for line in done.stdout.splitlines() if line.startswith("ANSWER")]
    if not answers:
        raise RuntimeError((done.stderr.strip().splitlines() or ["no answer"])[-1])
    return Taken(*map(float, answers[0]))


def answer(kind: str) -> None:
    """Bake one kind of scene, and print what it took."""
    import bpy
    import numpy as np

    import blender_addon
    from blender_addon import baking
    from core.presets import Library
    from core.steps import drain

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    scene, library, taken = _scene(kind), Library(None), []
    with one_blas_thread():
        for _ in range(TURNS):
            baking.forget()
            before = time.process_time()
            made = drain(baking.bake(scene, library, cores=1))
            taken.append(time.process_time() - before)
    force = max(float(np.abs(skin.force).max(initial=0.0)) for skin in made.skins.values())
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print("ANSWER", min(taken), most, force)


def _scene(kind: str):
    """Return boxes in a square about the origin, and a finger that touches those in its middle."""
    import bpy
    import numpy as np

    from tests.blender import build

    scene = build.span(1, FRAMES)
    line = (np.arange(SIDE) - SIDE / 2) * APART
    places = np.array([(x, y, 0.0) for y in line for x in line])
    if kind == "joined":
        vertices = (places[:, None] + SIZE * np.array(build.CUBE)).reshape(-1, 3)
        faces = np.array(build.CUBE_FACES) + 8 * np.arange(len(places))[:, None, None]
        build.mesh_object("Boxes", vertices, faces.reshape(-1, 4)).dermis.role = "TOUCHABLE"
    else:
        host = build.mesh_object("Boxes", places, [])
        tree = bpy.data.node_groups.new("Boxes", "GeometryNodeTree")
        for way in ("INPUT", "OUTPUT"):
            tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
        begin, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
        scatter = tree.nodes.new("GeometryNodeInstanceOnPoints")
        tree.links.new(begin.outputs[0], scatter.inputs["Points"])
        tree.links.new(scatter.outputs[0], end.inputs[0])
        if kind == "bodies":
            shown = tree.nodes.new("GeometryNodeObjectInfo")
            shown.inputs["Object"].default_value = build.cube("Box", SIZE, (0.0, 0.0, -9.0))
            shown.inputs["As Instance"].default_value = True
            tree.links.new(shown.outputs["Geometry"], scatter.inputs["Instance"])
        else:
            host.dermis.role = "TOUCHABLE"
            box = tree.nodes.new("GeometryNodeMeshCube")
            box.inputs["Size"].default_value = (SIZE, SIZE, SIZE)
            tree.links.new(box.outputs[0], scatter.inputs["Instance"])
        host.modifiers.new("Nodes", "NODES").node_group = tree
    tip = build.finger("Finger")
    tip.dermis.finger.skin.shown, tip.dermis.finger.skin.level = True, "draft"
    top = 0.5 * SIZE
    path = [(0.0, 0.0, 0.05), (0.0, 0.0, top - 0.5e-3), (0.005, 0.0, top - 0.5e-3)]
    build.keys(tip, "location", [1, 6, FRAMES], path)
    tip.dermis.finger.devices.add().preset = "haptip"
    bpy.context.view_layer.update()
    return scene
