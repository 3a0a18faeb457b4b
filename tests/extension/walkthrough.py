"""Do with the zip what a user does, in an isolated profile; the demo and the tests of this folder walk the same way.

`python walkthrough.py ZIP OUT --report FILE` installs the zip, adds the demo scene, bakes it, exports its tracks,
plots them and saves the .blend. It runs by its path, so nothing of the source tree can be imported: what works here
works from the zip. BLENDER_USER_RESOURCES has to name the profile before Blender loads. In a Blender of its own:
`blender --background --python walkthrough.py -- ZIP OUT --report FILE`. With `--reference FOLDER` the tracks are held
to those that another machine wrote there.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy

REPOSITORY = "user_default"
PACKAGE = f"bl_ext.{REPOSITORY}.dermis"
SCENE_FILE = "dermis_demo.blend"
SAME = 1e-9  # of a column's largest value: rounding in numpy and SciPy differs between systems, kernels do not


def install(zip_path: Path, enable: bool = True) -> None:
    """Install from disk, as Preferences > Get Extensions does."""
    if not os.environ.get("BLENDER_USER_RESOURCES"):
        raise SystemExit("set BLENDER_USER_RESOURCES to an empty folder first, so that your own profile stays as it is")
    done(
        bpy.ops.extensions.package_install_files(
            filepath=str(Path(zip_path).resolve()), repo=REPOSITORY, enable_on_install=enable
        )
    )
    if enable and PACKAGE not in bpy.context.preferences.addons:
        raise RuntimeError("the zip was installed but the add-on is not enabled: see the messages above")


def uninstall() -> None:
    """Uninstall, as Preferences > Get Extensions does."""
    repos = bpy.context.preferences.extensions.repos
    index = next(i for i, repo in enumerate(repos) if repo.module == REPOSITORY)
    done(bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="dermis"))


def package_folder() -> Path:
    """Return the folder into which the extension is installed."""
    repos = bpy.context.preferences.extensions.repos
    return Path(next(repo.directory for repo in repos if repo.module == REPOSITORY)) / "dermis"


def part(name: str) -> ModuleType:
    """Import a module of the installed extension, such as 'core.plot'."""
    return import_module(f"{PACKAGE}.{name}")


def policy_warnings() -> dict[str, Any]:
    """Return what Blender itself has to say against the extensions that are loaded; empty is clean.

    Private functions of Blender, the ones behind the warnings in Preferences; this is their only caller.
    """
    import addon_utils

    addon_utils._is_first_reset()
    return dict(addon_utils._extensions_warnings_get())


def done(result: set[str]) -> None:
    """Insist that an operator did its work; its errors arrive as exceptions, a refusal as CANCELLED."""
    if result != {"FINISHED"}:
        raise RuntimeError(f"the operator answered {result}")


def walk(zip_path: Path, out: Path) -> dict[str, Any]:
    """Take the whole way; return the files written (relative to `out`) and the seconds of each stage."""
    seconds: dict[str, float] = {}

    @contextmanager
    def stage(name: str) -> Iterator[None]:
        started = time.perf_counter()
        yield
        seconds[name] = time.perf_counter() - started
        print(f"{name}: {seconds[name]:.2f} s", flush=True)

    out = Path(out).resolve()
    with stage("install"):
        install(zip_path)
    with stage("scene"):
        done(bpy.ops.dermis.demo_scene())
    with stage("bake"):
        done(bpy.ops.dermis.bake())
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.csv")}
    with stage("export"):
        done(bpy.ops.dermis.export_tracks(directory=str(out)))
    tracks = sorted(p for p in out.rglob("*.csv") if before.get(p) != p.stat().st_mtime_ns)
    if not tracks:
        raise RuntimeError(f"the export left no track in {out}")
    with stage("plots"):
        plots = [plot(track) for track in tracks]
    with stage("save"):
        done(bpy.ops.wm.save_as_mainfile(filepath=str(out / SCENE_FILE), copy=True))
    written = [*tracks, *plots, out / SCENE_FILE]
    kernels = part("core.kernels.library").kernels().path.name
    names = [p.relative_to(out).as_posix() for p in written]
    return {"written": names, "scene": SCENE_FILE, "seconds": seconds, "kernels": kernels, "python": sys.version}


def compare(out: Path, reference: Path) -> float:
    """Return how far the tracks of two folders are apart at most, of the largest value of each column.

    Raises:
        RuntimeError: there is none, or another number of tracks, channels or samples.
    """
    import numpy as np

    names = sorted(p.relative_to(reference).as_posix() for p in reference.rglob("*.csv"))
    if not names or names != sorted(p.relative_to(out).as_posix() for p in out.rglob("*.csv")):
        raise RuntimeError(f"not the same tracks as in {reference}: {names}")
    worst = 0.0
    for name in names:
        ours, theirs = (part("core.track.csv").read(folder / name) for folder in (out, reference))
        if ours.values.shape != theirs.values.shape or not np.array_equal(ours.times, theirs.times):
            raise RuntimeError(
                f"{name}: {ours.values.shape} values, in the reference {theirs.values.shape}, or other times"
            )
        scale = np.maximum(np.abs(theirs.values).max(axis=0), 1e-12)
        worst = max(worst, float((np.abs(ours.values - theirs.values) / scale).max()))
    return worst


def plot(track: Path) -> Path:
    """Draw a track from its file, with the engine inside the extension."""
    picture = track.with_suffix(".png")
    part("core.plot.track").write_png(part("core.track.csv").read(track), picture)
    return picture


def main(arguments: list[str]) -> int:
    """Walk, and write the report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("zip", type=Path, help="the extension")
    parser.add_argument("out", type=Path, help="an existing folder to write into")
    parser.add_argument("--report", type=Path, required=True, help="where to write the JSON report")
    parser.add_argument("--reference", type=Path, help="folder with the tracks of another machine")
    options = parser.parse_args(arguments)
    report = walk(options.zip, options.out)
    if options.reference:
        report["apart"] = compare(options.out, options.reference)
        print(f"apart from the reference: {report['apart']:.3g}, allowed {SAME:g}", flush=True)
    options.report.write_text(json.dumps(report), encoding="utf-8")
    return int(report.get("apart", 0.0) > SAME)


if __name__ == "__main__":
    status = 1
    try:
        status = main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
    except Exception:
        sys.excepthook(*sys.exc_info())
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # Blender 4.5 hangs where the interpreter ends with an add-on still registered
