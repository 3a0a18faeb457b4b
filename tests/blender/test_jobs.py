"""Jobs: the same bake whether drained at once or a sample at a time, and everything back after Esc."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon import baking, changes, jobs, reporting
from core.errors import DermisError, Finding
from core.pipeline.bake import Progress
from core.presets import Library
from core.steps import drain
from tests.blender import build


@pytest.fixture
def scene(tmp_path):
    made = build.span(1, 25)
    build.cube("Cube", 0.2)
    tip = build.finger("Finger", (0, 0, 0.3))
    build.keys(tip, "location", [1, 13, 25], [(0, 0, 0.2), (0, 0, 0.1), (0.05, 0, 0.1)])
    tip.dermis.finger.devices.add().preset = "haptip"
    return made


def library() -> Library:
    return Library(None)


def test_a_bake_gives_a_track_and_restores_the_frame(scene):
    scene.frame_set(9, subframe=0.5)
    seen = []
    bake = drain(baking.bake(scene, library()), seen.append)
    assert [(o.finger, o.device) for o in bake.outputs] == [("Finger", "haptip")]
    assert (scene.frame_current, scene.frame_subframe) == (9, 0.5)
    stages = [p.stage for p in seen]
    assert stages[0] == "preparing" and "devices" in stages
    sampling_steps = [p.done for p in seen if p.stage == "sampling" and p.total == 241]
    assert sampling_steps == sorted(sampling_steps) and sampling_steps[-1] == 241
    again = drain(baking.bake(scene, library()))
    assert again.content_hash == bake.content_hash
    np.testing.assert_array_equal(again.outputs[0].track.values, bake.outputs[0].track.values)


def test_closing_in_the_middle_restores_everything(scene):
    scene.frame_set(9, subframe=0.5)
    steps = baking.bake(scene, library())
    for _ in range(40):
        next(steps)
    assert scene.frame_current != 9
    steps.close()
    assert (scene.frame_current, scene.frame_subframe) == (9, 0.5)
    changes.clear_dirty()
    changes.mark_dirty("probe")
    assert changes.dirty() == {"probe"}


def test_findings_of_the_sweep_reach_the_bake(scene):
    build.keys(bpy.data.objects["Cube"], "hide_viewport", [1, 13], [0, 1], "CONSTANT")
    bake = drain(baking.bake(scene, library()))
    assert [f.count for f in bake.findings if f.code == "absent"] == [121]


class DERMIS_TEST_OT_job(jobs.Job, bpy.types.Operator):
    """A job that counts"""

    bl_idname = "dermis_test.job"
    bl_label = "Job"
    fail = False
    seen: list = []

    def steps(self, context):
        """Yield three times."""
        for i in range(3):
            yield Progress("counting", i, 3)
        if type(self).fail:
            raise DermisError("it will not", where="here", remedy="Do not")
        return 42

    def finished(self, context, result):
        """Keep the result."""
        self.seen.append(result)
        return {"FINISHED"}


@pytest.fixture
def operator():
    bpy.utils.register_class(DERMIS_TEST_OT_job)
    DERMIS_TEST_OT_job.fail, DERMIS_TEST_OT_job.seen = False, []
    yield DERMIS_TEST_OT_job
    bpy.utils.unregister_class(DERMIS_TEST_OT_job)


def test_an_operator_runs_straight_through_in_background(operator):
    assert bpy.ops.dermis_test.job() == {"FINISHED"}
    assert bpy.ops.dermis_test.job("INVOKE_DEFAULT") == {"FINISHED"}
    assert operator.seen == [42, 42]


def test_a_refusal_becomes_a_report_and_a_finding(operator):
    operator.fail = True
    with pytest.raises(RuntimeError, match="here: it will not. Do not."):
        bpy.ops.dermis_test.job()
    assert [(f.severity, f.what) for f in reporting.findings()] == [("error", "it will not")]


def test_findings_are_listed_worst_first_and_once():
    info, warning, error = (Finding(s, s, f"what {s}") for s in ("info", "warning", "error"))
    reporting.show([info, warning, error, info], "Bake")
    assert [f.severity for f in reporting.findings()] == ["error", "warning", "info"]
    assert reporting.source() == "Bake"
    reporting.forget()
    assert reporting.findings() == ()


def test_disabling_the_add_on_stops_what_runs(scene):
    steps = baking.bake(scene, library())
    for _ in range(40):
        next(steps)
    jobs._running.append(steps)
    jobs.unregister()
    assert scene.frame_current == 1 and not jobs._running
    with pytest.raises(StopIteration):
        next(steps)


def test_how_far_a_job_is_goes_with_it(scene):
    jobs._show(jobs.Progress("Bake", 0.25, "sampling, 25%"))
    assert jobs.progress().share == 0.25
    jobs.unregister()
    assert jobs.progress() is None


@pytest.mark.one_line("3.13", "processes of the engine; the rest of this file runs on both lines")
def test_a_bake_on_all_cores_is_that_of_one_and_can_be_left(scene, monkeypatch):
    build.cube("Other Cube", 0.2, location=(1.0, 0.0, 0.0))
    tips = [bpy.data.objects["Finger"], build.finger("Other Finger", (1.0, 0.0, 0.3))]
    build.keys(tips[1], "location", [1, 13, 25], [(1, 0, 0.2), (1, 0, 0.0985), (1.003, 0, 0.0985)])
    build.keys(tips[0], "location", [1, 13, 25], [(0, 0, 0.2), (0, 0, 0.098), (0.003, 0, 0.098)])
    for tip in tips:
        tip.dermis.finger.skin.shown, tip.dermis.finger.skin.level = True, "draft"
    monkeypatch.setattr("core.pipeline.shares.SAVED", 1)
    baked, told = {}, {}
    for cores in (1, 2):
        monkeypatch.setattr(baking, "setting", lambda _name, cores=cores: cores)
        told[cores] = []
        baking.forget()
        baked[cores] = drain(baking.bake(scene, library()), told[cores].append)
    assert "fingers" in {p.stage for p in told[2]} and "fingers" not in {p.stage for p in told[1]}
    assert baked[1].content_hash == baked[2].content_hash and len(baked[2].skins) == 2
    for name, skin in baked[1].skins.items():
        assert skin.force.any() and skin.force.tobytes() == baked[2].skins[name].force.tobytes()
    baking.forget()
    steps = baking.bake(scene, library())
    while next(steps).stage != "fingers":
        pass
    steps.close()
    assert not own_workers(), "a process went on"


@pytest.mark.one_line("3.11", "the engine keeps shares; the rest of this file runs on both lines")
def test_a_second_bake_renders_whom_a_change_concerns(scene):
    build.cube("Other Cube", 0.2, location=(1.0, 0.0, 0.0))
    tips = [bpy.data.objects["Finger"], build.finger("Other Finger", (1.0, 0.0, 0.3))]
    build.keys(tips[1], "location", [1, 13, 25], [(1, 0, 0.2), (1, 0, 0.0985), (1.003, 0, 0.0985)])
    build.keys(tips[0], "location", [1, 13, 25], [(0, 0, 0.2), (0, 0, 0.098), (0.003, 0, 0.098)])
    for tip in tips:
        tip.dermis.finger.skin.shown, tip.dermis.finger.skin.level = True, "draft"

    def baked():
        return drain(baking.bake(scene, library(), cores=1))

    first, again = baked(), baked()
    assert "fingers_unchanged" not in first.skipped and again.skipped["fingers_unchanged"] == 2
    assert "skin contact" in first.stage_seconds and "skin contact" not in again.stage_seconds
    bpy.data.objects["Other Cube"].dermis.material.friction = 0.05
    changed = baked()
    assert changed.skipped["fingers_unchanged"] == 1
    baking.forget()
    fresh = baked()
    assert "fingers_unchanged" not in fresh.skipped and fresh.content_hash == changed.content_hash
    for name, skin in fresh.skins.items():
        assert skin.force.any() and skin.force.tobytes() == changed.skins[name].force.tobytes()
        assert (skin.force.tobytes() == first.skins[name].force.tobytes()) == (name == "Finger")
    path = str(bpy.app.tempdir) + "again.blend"
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    scene = bpy.context.scene
    assert "fingers_unchanged" not in drain(baking.bake(scene, library(), cores=1)).skipped, "another file"


def own_workers() -> list[int]:
    """Return the living children of this process that work for it."""
    found: list[int] = []
    for task in Path("/proc/self/task").iterdir():
        with suppress(FileNotFoundError):  # a thread that has ended meanwhile
            found += [int(pid) for pid in (task / "children").read_text().split()]
    return [pid for pid in found if "work" in Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")]
