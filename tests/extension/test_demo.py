"""The demo, as the README's first command runs it: from the zip to tracks, plots and the scene."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def walked(fresh_blender: Any, zip_path: Path, tmp_path: Path) -> tuple[Path, dict[str, Any]]:
    """The folder the demo wrote, and its report."""
    out = tmp_path / "demo out"
    out.mkdir()
    report = fresh_blender(f"import walkthrough\nanswer = walkthrough.walk({str(zip_path)!r}, {str(out)!r})")
    return out, report


def test_demo_writes_tracks_plots_and_the_scene(walked: tuple[Path, dict[str, Any]], fresh_blender: Any) -> None:
    out, report = walked
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


def test_the_saved_scene_opens_again(walked: tuple[Path, dict[str, Any]], fresh_blender: Any) -> None:
    """The same profile, a new Blender: the scene bakes to the same bytes."""
    out, report = walked
    again = out.with_name("again")
    again.mkdir()
    fresh_blender(
        "import bpy, addon_utils, walkthrough\n"
        "assert addon_utils.enable(walkthrough.PACKAGE) is not None\n"
        f"walkthrough.done(bpy.ops.wm.open_mainfile(filepath={str(out / report['scene'])!r}))\n"
        "walkthrough.done(bpy.ops.dermis.bake())\n"
        f"walkthrough.done(bpy.ops.dermis.export_tracks(directory={str(again)!r}))\n"
    )
    first = {p.name: p.read_bytes() for p in out.glob("*.csv")}
    assert first and {p.name: p.read_bytes() for p in again.glob("*.csv")} == first


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
