"""A random walk through the add-on: operators, settings, undo, reloads, re-enabling. Nothing may fail or stay behind.

Six seconds by default, ten minutes with --long. A failure says the seed and the last steps; the same seed walks the
same way, however far the time lets it come.
"""

from __future__ import annotations

import os
import random
import tempfile
import time
from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Any

import bpy
import pytest

import blender_addon
from blender_addon import doubts, jobs, operators, panels, redraw, views
from blender_addon.preview import device_preview
from blender_addon.streaming import session
from blender_addon.viewport import shown

from . import build

SECONDS, LONG = 6.0, 600.0
# Other add-ons of Blender fail in handlers of theirs: Rigify does in some files after it was enabled once.
OURS = [Path(blender_addon.__file__).parent, Path(__file__).resolve().parents[2] / "core"]
DEVICES = ("haptip", "electrovibration", "pin_array_128", "thimble_3rrs", "cable_platform", "hexapod", "gone", "")
SKINS = ("index_medium", "thumb_small", "little_medium", "gone")
# What would open windows or files of the system, talk to hardware, or compute for minutes.
LEFT_OUT = {
    *("open_presets", "calibration_folder", "stream_rescan", "adapt_thimble", "design", "make_table", "compare_pins"),
    *(
        "press_test",
        "plot_thimble",
        "find_floor",
        "demo_skin_scene",
        "demo_pins_scene",
        "demo_thimble_scene",
        "demo_motors_scene",
    ),
}
# Settings that make a step take long, or name files; of the others any value that they take is tried.
KEPT = {"level", "sample_rate", "table_rows", "live_trail", "url", "frame_start", "frame_end", "rna_type"}
KEPT |= {"use_range", "bake_range"}


class Sink:
    """A layout that takes whatever is drawn, and looks whether it exists."""

    def __call__(self, *_args: Any, **_named: Any) -> Sink:
        return self

    def __getattr__(self, name: str) -> Any:
        return self

    def prop(self, data: Any, name: str, **_: Any) -> None:
        """Look up a property."""
        assert name in data.bl_rna.properties, f"{data} has no {name}"

    def operator(self, name: str, **_: Any) -> Any:
        """Return what takes an operator's settings."""
        group, _, own = name.partition(".")
        return Settings(getattr(getattr(bpy.ops, group), own).get_rna_type().properties)


class Settings:
    """An operator's settings, as a button sets them."""

    def __init__(self, known: Any) -> None:
        object.__setattr__(self, "known", known)

    def __setattr__(self, name: str, _value: Any) -> None:
        assert name in self.known, name


class Walk:
    """What a person may do, drawn by lot."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.chance, self.folder, self.log = random.Random(seed), folder, [f"seed {seed}"]
        self.steps: tuple[tuple[int, Callable[[], Any]], ...] = (
            (6, self.setting),
            (6, self.press),
            (2, self.device),
            (2, self.role),
            (3, self.frame),
            (3, self.select),
            (2, self.move),
            (1, self.key),
            (2, self.add),
            (1, self.remove),
            (1, self.parent),
            (1, self.scene),
            (3, self.draw),
            (4, self.undo),
            (2, self.redo),
            (1, self.reload),
            (1, self.enable),
        )

    def go(self, seconds: float) -> int:
        """Walk for so long; return how many steps it was."""
        end, count = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            (step,) = self.chance.choices([s for _, s in self.steps], [w for w, _ in self.steps])
            self.log.append(step.__name__)
            step()
            self.tell(lambda: bpy.ops.ed.undo_push(message="step"))
            if self.chance.random() < 0.3:
                bpy.context.view_layer.update()
            shown.work()
            count += 1
        return count

    def tell(self, call: Callable[[], Any]) -> Any:
        """Call something of Blender as a window would; it may refuse in words."""
        try:
            with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
                return call()
        except RuntimeError as error:
            assert "Traceback" not in str(error), f"{self.log[-12:]}\n{error}"
            return None

    # -- steps ----------------------------------------------------------------------------------------------------

    def setting(self) -> None:
        """Set any setting to any value that it takes."""
        scene, obj = bpy.context.scene, self.thing()
        groups = [scene.dermis, scene.dermis.skin_view, scene.dermis.thimble_view, scene.dermis_stream]
        groups.append(scene.dermis_design)
        if obj is not None:
            own = obj.dermis
            groups += [own.finger, own.finger.skin, own.material, own.screen, *own.finger.devices] * 2
        group = self.chance.choice(groups)
        rows = [p for p in group.bl_rna.properties if not p.is_readonly and p.identifier not in KEPT]
        row = self.chance.choice(rows)
        value = self.value(group, row)
        if value is not None:
            self.log[-1] = f"{group.path_from_id()}.{row.identifier} = {value!r}"
            setattr(group, row.identifier, value)

    def value(self, group: Any, row: Any) -> Any:
        """Return a value that a property takes; None for files, pointers and collections."""
        if row.type == "ENUM" and not row.is_enum_flag:
            return self.chance.choice([item.identifier for item in row.enum_items] or [None])
        if row.type == "BOOLEAN":
            return self.chance.random() < 0.5
        if row.type in ("FLOAT", "INT") and not row.is_array:
            low, high = (end if isfinite(end) and abs(end) < 1e6 else 0.0 for end in (row.soft_min, row.soft_max))
            value = self.chance.choice((low, high, self.chance.uniform(low, high), row.default))
            return int(value) if row.type == "INT" else value
        if row.type == "STRING" and row.identifier == "preset":
            return self.chance.choice(SKINS if "level" in group.bl_rna.properties else DEVICES)
        return None

    def press(self) -> None:
        """Press any button, with any settings."""
        names = [c.bl_idname.partition(".")[2] for c in operators.CLASSES if issubclass(c, bpy.types.Operator)]
        name = self.chance.choice([name for name in names if name not in LEFT_OUT])
        operator, given = getattr(bpy.ops.dermis, name), {}
        for row in operator.get_rna_type().properties:
            if row.identifier in ("filepath", "directory"):
                given[row.identifier] = str(self.folder / "out" / name)
            elif row.identifier == "preset":
                given["preset"] = self.chance.choice((*DEVICES, *SKINS, "rubber"))
            elif row.identifier == "name":
                given["name"] = self.chance.choice(("", "Mine", "Rubber", *(o.name for o in bpy.context.scene.objects)))
            elif row.identifier != "rna_type" and self.chance.random() < 0.5:
                value = self.value(operator.get_rna_type(), row)
                if value is not None:
                    given[row.identifier] = value
        self.log[-1] = f"{name}({given})"
        if name in ("bake", "export_screen_maps"):
            bpy.context.scene.frame_end = bpy.context.scene.frame_start + 3
            for obj in bpy.context.scene.objects:
                obj.dermis.finger.skin.shown = False  # solving takes its time elsewhere
                for device in obj.dermis.finger.devices:
                    device.enabled = device.preset in DEVICES[:2]
        if operator.poll():
            self.tell(lambda: operator(**given))

    def device(self) -> None:
        finger = self.thing("FINGER")
        if finger is not None:
            devices = finger.dermis.finger.devices
            if len(devices) > 2:
                devices.remove(self.chance.randrange(len(devices)))
            else:
                devices.add().preset = self.chance.choice(DEVICES)
            finger.dermis.finger.active_device = self.chance.randrange(4)

    def role(self) -> None:
        obj = self.thing()
        if obj is not None:
            obj.dermis.role = self.chance.choice(("NONE", "FINGER", "TOUCHABLE", "SCREEN"))

    def frame(self) -> None:
        self.tell(
            lambda: bpy.context.scene.frame_set(self.chance.randint(0, 40), subframe=self.chance.choice((0, 0.5)))
        )
        device_preview.step(bpy.context)

    def select(self) -> None:
        for obj in bpy.context.view_layer.objects:
            obj.select_set(self.chance.random() < 0.4)
        bpy.context.view_layer.objects.active = self.chance.choice((None, self.thing(), self.thing()))

    def move(self) -> None:
        obj = self.thing()
        if obj is not None:
            obj.location = [self.chance.uniform(-0.03, 0.03) for _ in range(3)]
            obj.scale = [self.chance.choice((1.0, 1.0, 1.0, 2.0, 0.0, -1.0)) for _ in range(3)]

    def key(self) -> None:
        obj = self.thing()
        if obj is not None:
            obj.keyframe_insert("location", frame=self.chance.randint(1, 30))

    def add(self) -> None:
        kind = self.chance.choice(("finger", "cube", "screen", "armature"))
        name = self.chance.choice(("Index", "Thumb", "Ring.L", "Thing"))
        if kind == "armature":
            obj = bpy.data.objects.new(name, bpy.data.armatures.new(name))
            bpy.context.scene.collection.objects.link(obj)
        else:
            obj = {"finger": build.finger, "cube": build.cube, "screen": build.screen}[kind](name)
            obj.dermis.finger.skin.level = "draft"
            obj.location.z = self.chance.uniform(0.0, 0.05)
            obj.dermis.finger.skin.mesh_file = ""

    def remove(self) -> None:
        obj = self.thing()
        if obj is not None:
            bpy.data.objects.remove(obj)

    def parent(self) -> None:
        child, above = self.thing(), self.thing()
        if child is not None and above is not None and above is not child:
            try:
                child.parent = self.chance.choice((None, above))
            except (RuntimeError, ValueError):
                pass  # a loop, which Blender refuses

    def scene(self) -> None:
        scenes = list(bpy.data.scenes)
        if len(scenes) > 2:
            bpy.data.scenes.remove(self.chance.choice(scenes))
        bpy.context.window_manager.windows[0].scene = self.chance.choice((bpy.data.scenes.new("S"), *bpy.data.scenes))

    def draw(self) -> None:
        """Draw all panels and menus that are there, and what the view shows but its pixels."""
        for cls in panels.CLASSES:
            if not hasattr(cls, "draw") or not there(cls):
                continue
            for part in ("draw_header", "draw"):
                if hasattr(cls, part):
                    getattr(cls, part)(_Drawn(cls), bpy.context)
        doubts.look(bpy.context.scene, bpy.context.view_layer)

    def undo(self) -> None:
        self.tell(lambda: bpy.ops.ed.undo.poll() and bpy.ops.ed.undo())

    def redo(self) -> None:
        self.tell(lambda: bpy.ops.ed.redo.poll() and bpy.ops.ed.redo())

    def reload(self) -> None:
        path = str(self.folder / "walk.blend")
        bpy.ops.wm.save_as_mainfile(filepath=path)
        bpy.ops.wm.open_mainfile(filepath=path)

    def enable(self) -> None:
        blender_addon.unregister()
        assert stayed() == []
        blender_addon.register()

    def thing(self, role: str = "") -> Any:
        """Return any object of a role, or None."""
        found = [o for o in bpy.context.scene.objects if not role or o.dermis.role == role]
        return self.chance.choice(found) if found else None


def there(cls: Any) -> bool:
    """Return whether Blender would draw a panel or menu: those around it are asked first, as it does."""
    parent = getattr(bpy.types, getattr(cls, "bl_parent_id", ""), None)
    return (parent is None or there(parent)) and (not hasattr(cls, "poll") or bool(cls.poll(bpy.context)))


class _Drawn:
    """What a panel sees as itself: its own methods, and a layout."""

    def __init__(self, cls: type) -> None:
        self._cls, self.layout = cls, Sink()

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._cls, name)
        return found.__get__(self) if callable(found) else found


def stayed() -> list[str]:
    """Return what the add-on has left in Blender after it was disabled."""
    found = [n for n in dir(bpy.types) if n.startswith("DERMIS_")]
    found += [n for n in ("Object", "Scene") if "dermis" in getattr(bpy.types, n).bl_rna.properties]
    for name in dir(bpy.app.handlers):
        calls = getattr(bpy.app.handlers, name)
        if isinstance(calls, list):
            found += [f"{name}: {f}" for f in calls if getattr(f, "__module__", "").startswith("blender_addon")]
    found += [str(handle) for handle in (*views._handles, *views._keys)]
    found += [str(f) for f in (redraw._on_timer, session._on_timer) if bpy.app.timers.is_registered(f)]
    return found + (["a job"] if jobs._running or jobs.progress() else [])


def open_files() -> set[str]:
    """Return the files of this process that are open."""
    found = set()
    for number in os.listdir("/proc/self/fd"):
        try:
            found.add(os.readlink(f"/proc/self/fd/{number}"))
        except OSError:
            continue  # the one that lists them
    return {name for name in found if name.startswith("/") and not name.startswith(("/dev", "/proc"))}


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="open files are counted by Linux's list of them")
def test_a_walk_fails_nowhere_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], request: pytest.FixtureRequest
) -> None:
    preferences = bpy.context.preferences  # Blender's usual undo of deleted blocks has a defect of its own
    preferences.view.show_developer_ui = preferences.experimental.use_undo_legacy = True
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    for folder in ("temporary", "out"):
        (tmp_path / folder).mkdir()
    long = request.config.getoption("--long")
    seeds = range(1, 13) if long else (int(os.environ.get("DERMIS_WALK", "1")),)
    before, count = open_files(), 0
    for seed in seeds:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        preferences = bpy.context.preferences
        preferences.view.show_developer_ui = preferences.experimental.use_undo_legacy = True
        walk = Walk(seed, tmp_path)
        try:
            count += walk.go((LONG if long else SECONDS) / len(seeds))
        except Exception as error:
            raise AssertionError(" | ".join(walk.log[:1] + walk.log[-15:])) from error
        out, err = capfd.readouterr()
        failed = [part for part in (out + err).split("Traceback")[1:] if any(str(o) in part for o in OURS)]
        assert not failed, f"{walk.log[0]}\n{failed[0][:4000]}"
    assert count > 5 * len(seeds)
    blender_addon.unregister()
    try:
        assert stayed() == []
        assert {n for n in open_files() - before if not n.endswith((".so", ".dat")) and "deleted" not in n} == set()
        assert [p for p in tmp_path.rglob("*") if p.name.endswith((".part", ".tmp"))] == []
    finally:
        blender_addon.register()
