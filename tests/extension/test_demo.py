"""The demo, as the README's first command runs it: from the zip to tracks, plots and the scene."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Walked = tuple[Path, dict[str, Any], Callable[..., Any]]


@pytest.fixture(scope="module")
def walked(blender_in: Any, zip_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Walked:
    """The folder the demo wrote, its report, and what runs code in a new Blender of the same profile."""
    folder = tmp_path_factory.mktemp("demo")
    out, run = folder / "demo out", blender_in(folder)
    out.mkdir()
    return out, run(f"import walkthrough\nanswer = walkthrough.walk({str(zip_path)!r}, {str(out)!r})"), run


def test_demo_writes_tracks_plots_and_the_scene(walked: Walked) -> None:
    out, report, _ = walked
    tracks = sorted(out.glob("*.csv"))
    assert tracks and (out / report["scene"]).stat().st_size > 0
    assert sorted(report["written"]) == sorted(p.name for p in out.iterdir())
    kinds = set()
    for track in tracks:
        lines = track.read_text(encoding="utf-8").split("\n")
        assert lines[0] == "# dermis-track 1" and lines[-1] == ""
        table = [line for line in lines if line and not line.startswith("#")]
        kinds |= {line.removeprefix("# kind: ") for line in lines if line.startswith("# kind: ")}
        times = [float(line.split(",")[0]) for line in table[1:]]
        assert table[0].startswith("t_s,") and len(times) > 1000
        steps = {round(1e6 * (b - a)) for a, b in zip(times, times[1:], strict=False)}
        assert steps == {1000}, "both devices of the demo are driven at 1 kHz"
        moving = {line.split(",", 1)[1] for line in table[1:]}
        assert len(moving) > 100, "a demo track in which nothing happens shows nothing"
        assert_is_png(track.with_suffix(".png"))
    assert kinds == {"shear_tactor", "friction_screen"}, "the demo shows both ways of rendering"


def test_the_saved_scene_opens_again(walked: Walked) -> None:
    """The same profile, a new Blender: the scene bakes to the same bytes."""
    out, report, run = walked
    again = out.with_name("again")
    again.mkdir()
    run(
        "import bpy, addon_utils, walkthrough\n"
        "assert addon_utils.enable(walkthrough.PACKAGE) is not None\n"
        f"walkthrough.done(bpy.ops.wm.open_mainfile(filepath={str(out / report['scene'])!r}))\n"
        "walkthrough.done(bpy.ops.dermis.bake())\n"
        f"walkthrough.done(bpy.ops.dermis.export_tracks(directory={str(again)!r}))\n"
    )
    first = {p.name: p.read_bytes() for p in out.glob("*.csv")}
    assert first and {p.name: p.read_bytes() for p in again.glob("*.csv")} == first


@pytest.mark.one_line("3.11", "tracks are compared as numbers; the demo is walked on both lines")
def test_tracks_are_held_to_those_of_another_machine(zip_path: Path, tmp_path: Path) -> None:
    """As the host's workflow does in Blender's own builds: the same tracks pass, and one value that differs fails."""
    script, environment = str(Path(__file__).with_name("walkthrough.py")), {**os.environ}
    environment["BLENDER_USER_RESOURCES"] = str(tmp_path / "profile")
    environment.pop("PYTHONPATH", None)

    def walk(name: str, *more: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / name).mkdir()
        command = [
            sys.executable,
            script,
            str(zip_path),
            str(tmp_path / name),
            "--report",
            str(tmp_path / "report.json"),
        ]
        return subprocess.run([*command, *more], env=environment, capture_output=True, text=True, timeout=300)

    assert walk("first").returncode == 0
    again = walk("again", "--reference", str(tmp_path / "first"))
    assert again.returncode == 0 and "apart from the reference: 0," in again.stdout
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["apart"] == 0.0 and "dermis-" in report["kernels"]
    track = next((tmp_path / "first").glob("*.csv"))
    lines = track.read_text().split("\n")
    at = len(lines) - 200
    cells = lines[at].split(",")
    cells[-1] = repr(float(cells[-1]) * (1 + 1e-6) + 1e-6)
    track.write_text("\n".join([*lines[:at], ",".join(cells), *lines[at + 1 :]]))
    assert walk("third", "--reference", str(tmp_path / "first")).returncode == 1


def assert_is_png(path: Path) -> None:
    """Check a PNG's signature, the checksum of every chunk, and that its pixels unpack to more than one value."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, pixels, kinds = 8, b"", []
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        body = data[at + 4 : at + 8 + length]
        assert zlib.crc32(body) == int.from_bytes(data[at + 8 + length : at + 12 + length], "big")
        kinds.append(body[:4])
        pixels += body[4:] if body[:4] == b"IDAT" else b""
        at += 12 + length
    assert kinds[0] == b"IHDR" and kinds[-1] == b"IEND"
    assert len(set(zlib.decompress(pixels))) > 2
