#!/usr/bin/env python3
"""Build, test, show and measure Dermis. Needs any Python from 3.8 on; what needs 3.11 or 3.13 finds one by itself.

Environments live in .venv/: `cp311` or `cp313` has Blender as a module (bpy) and the test tools, `cp311-wheels` has
what the extension brings (.ci/wheels.txt). They are apart: a scipy beside bpy would hide the one in the extension.
The kernels' compiler is in `zig` (.ci/kernels.txt); this machine's library lies beside its sources, in core/kernels/.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent
VENV = ROOT / ".venv"
DIST = ROOT / "dist"
LOCKS = ROOT / ".ci"
WHEELS = LOCKS / "wheels.txt"
BLENDER = {(3, 11): "4.5 LTS", (3, 13): "5.2 LTS"}  # the Python that each Blender line runs on
DEFAULT_PYTHONS = ("3.11", "3.13")
PINNED_PYTHONS = ("3.11", "3.13", "3.14")
PLATFORMS = {  # Blender's name: the wheel tags it can use, best first
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_14_0_arm64", "macosx_13_0_arm64", "macosx_12_0_arm64", "macosx_11_0_arm64"),
}
NEEDED_LIBRARIES = {  # what `import bpy` needs: Debian's package of each
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libEGL_mesa.so.0": "libegl-mesa0 libgl1-mesa-dri",
}
KERNELS = LOCKS / "kernels.txt"
INSTALL_PYTHON = "python.org, your system's packages, `pyenv install 3.13`, or `uv python install 3.13`"
DOCS = {  # pages in core/, and how each is written
    "API.md": [str(LOCKS / "api_page.py")],
    "PARAMETERS.md": ["-m", "tests.parameters_page"],
    "COMMANDS.md": ["-m", "tests.commands_page"],
}
LEVELS = ("unit", "blender", "extension")
LEVEL_LIMIT = 70 * 60  # [s] a level that takes longer hangs
# Memory [bytes] from which glibc gives arrays back to the system at once, and at the end of the heap: a fiftieth to a
# twentieth of the tests' processor time goes into pages that come again.
KEPT_MEMORY = {"MALLOC_MMAP_THRESHOLD_": "32000000", "MALLOC_TRIM_THRESHOLD_": "256000000"}
# Blender's undo can crash by itself (tests/blender/undo_defect.py): its tests have a process of their own, and so many
# tries where Blender dies. A test that fails has failed.
UNDO_TRIES = 3


def module_at(path: Path) -> Any:
    """Return a file as a module that needs the standard library alone, whatever the package around it needs."""
    spec = importlib.util.spec_from_file_location(f"dermis_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


building = module_at(ROOT / "core" / "kernels" / "building.py")
zips = module_at(ROOT / ".ci" / "zips.py")
Stop = zips.Refused  # a sentence for the person at the keyboard; the work ends with status 1


# -- the machine ------------------------------------------------------------------------------------------------------


def with_python(arguments: list[str]) -> int | None:
    """Do the work with a Python that Blender runs on: None where this is one, else the status of that one.

    Found on PATH, among pyenv's and conda's, or brought by uv; a message says which.
    """
    if sys.version_info[:2] in BLENDER and sys.implementation.name == "cpython":
        return None
    python = next(filter(runs, pythons()), None) or brought_by_uv()
    if python is None:
        raise Stop(
            f"This needs CPython 3.11 (for Blender 4.5 LTS) or 3.13 (for Blender 5.2 LTS), and there is none on PATH, "
            f"in pyenv or in conda; this is {platform.python_implementation()} {platform.python_version()}. "
            f"Install one ({INSTALL_PYTHON}) and try again."
        )
    say(f"this is Python {platform.python_version()}; going on with {python}")
    return subprocess.run([python, str(ROOT / "build_addon.py"), *arguments]).returncode


def pythons() -> Iterator[str]:
    """Yield commands that may be a Python that Blender runs on."""
    names = [f"{major}.{minor}" for major, minor in sorted(BLENDER, reverse=True)]
    for name in names:
        yield from filter(None, (shutil.which(f"python{name}"),))
    home = Path.home()
    place = Path("python.exe") if os.name == "nt" else Path("bin/python")
    condas = [Path(os.environ.get("CONDA_PREFIX") or home / "miniforge3"), home / "miniconda3", home / "anaconda3"]
    versions = [Path(os.environ.get("PYENV_ROOT") or home / ".pyenv") / "versions", *(c / "envs" for c in condas)]
    found = [entry for folder in versions if folder.is_dir() for entry in sorted(folder.iterdir())]
    yield from (str(entry / place) for entry in (*condas, *found) if (entry / place).exists())
    if os.name == "nt":
        for name in names:
            told = printed("py", f"-{name}", "-c", "import sys; print(sys.executable)")
            yield from filter(None, (told,))


def brought_by_uv() -> str | None:
    """Return a Python that uv has or fetches, None without uv."""
    if not shutil.which("uv"):
        return None
    for verb in ("find", "install"):
        if verb == "install":
            say("uv fetches Python 3.13")
            printed("uv", "python", "install", "3.13")
        for major, minor in sorted(BLENDER, reverse=True):
            found = printed("uv", "python", "find", f"{major}.{minor}")
            if found and runs(found):
                return found
    return None


def printed(*command: str) -> str:
    """Return what a command prints, '' where it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def runs(python: str) -> bool:
    """Tell whether a command is a CPython that Blender runs on: a version manager's shim may say that it is none."""
    told = printed(python, "-c", "import sys; print(sys.implementation.name, *sys.version_info[:2])")
    return told in {f"cpython {major} {minor}" for major, minor in BLENDER}


def this_platform() -> str:
    """Return Blender's name of this platform."""
    name: str = building.this_platform()
    if name not in PLATFORMS:
        raise Stop(f"There are no wheels for {name}: Dermis runs on {', '.join(PLATFORMS)}.")
    return name


def this_python() -> str:
    """Return the running Python's version, as wheels name it."""
    return f"{sys.version_info[0]}.{sys.version_info[1]}"


def missing_libraries() -> list[str]:
    """Return the system libraries that Blender needs and the loader does not find."""
    missing = []
    if sys.platform.startswith("linux"):
        for name in NEEDED_LIBRARIES:
            try:
                ctypes.CDLL(name)
            except OSError:
                missing.append(name)
    return missing


def need_packages(packages: list[str], why: str) -> None:
    """Install Debian packages where we may; otherwise stop with the exact command."""
    names = " ".join(packages)
    root = hasattr(os, "geteuid") and os.geteuid() == 0
    if not shutil.which("apt-get"):
        raise Stop(f"{why}. On Debian or Ubuntu the packages are called: {names}. Install your system's and try again.")
    if not root:
        raise Stop(f"{why}. Install with:\n  sudo apt-get update && sudo apt-get install -y {names}")
    say(f"{why}: installing {names}")
    environment = dict(os.environ, DEBIAN_FRONTEND="noninteractive")
    install = ["apt-get", "install", "-y", "--no-install-recommends", *names.split()]
    for command in (["apt-get", "update"], install):
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode and command is install:
            raise Stop(f"apt-get could not install {names}:\n{done.stdout[-2000:]}")


def say(text: str) -> None:
    """Print a line at once, so that it stands in order beside what child processes print."""
    print(text, flush=True)


# -- environments -----------------------------------------------------------------------------------------------------


class Environment(NamedTuple):
    """The interpreter that has bpy and the tools, and the folder with what the extension brings."""

    python: Path
    wheels: Path

    def variables(self, wheels: bool, **more: str) -> dict[str, str]:
        """Return the variables for a child: isolated from the user's own packages, one BLAS thread."""
        bytecode = "PYTHONDONTWRITEBYTECODE"  # Blender writes it, so what is measured does too
        dropped = ("PYTHONPATH", "PYTHONHOME", "BLENDER_USER_RESOURCES", "BLENDER_USER_EXTENSIONS", bytecode)
        kept = {k: v for k, v in os.environ.items() if k not in dropped}
        fixed = {"PYTHONNOUSERSITE": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONUTF8": "1"}
        return {**kept, **fixed, **({"PYTHONPATH": str(self.wheels)} if wheels else {}), **more}


def environment() -> Environment:
    """Make (or keep) the environment of the running Python; both parts are pinned and hashed."""
    version = this_python()
    tag = f"cp{version.replace('.', '')}"
    folder = VENV / tag
    python = inside(folder)
    lock = LOCKS / f"environment-{tag}.txt"
    this_platform()
    made = fresh(folder, lock)
    missing = [] if made or can_make_environments() else ["the venv module of this Python"]
    packages = [f"python{version}-venv"] if missing else []
    missing += missing_libraries()
    packages += [NEEDED_LIBRARIES[name] for name in missing if name in NEEDED_LIBRARIES]
    if packages:
        need_packages(packages, f"This machine lacks what Blender as a module needs ({', '.join(missing)})")
    if not made:
        say(f"making {folder.relative_to(ROOT)} (Blender {BLENDER[sys.version_info[:2]]} as a module; about 400 MB)")
        quietly([sys.executable, "-m", "venv", "--clear", str(folder)], "The environment could not be made")
        pip(python, "install", "-r", str(lock))
        quietly(
            [str(python), "-c", "import bpy, os, sys; sys.stdout.flush(); os._exit(0)"],
            "Blender was installed but does not start",
        )
        stamp(folder, lock)
    wheels = VENV / f"{tag}-wheels"
    if not fresh(wheels, WHEELS):
        source = wheel_folder(python, this_platform(), version)
        install_into(wheels, WHEELS, python, "--no-index", "--find-links", str(source))
    library(this_platform(), python)
    return Environment(python, wheels)


def inside(folder: Path) -> Path:
    """Return the interpreter of an environment."""
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def can_make_environments() -> bool:
    """Tell whether this Python has venv and pip; Debian keeps them in a package of their own."""
    try:
        import ensurepip  # noqa: F401
        import venv  # noqa: F401
    except ImportError:
        return False
    return True


def fresh(folder: Path, lock: Path) -> bool:
    """Tell whether a folder was made from this very list of requirements."""
    mark = folder / ".dermis-lock"
    return mark.is_file() and mark.read_text(encoding="utf-8") == zips.digest(lock)


def stamp(folder: Path, lock: Path) -> None:
    """Mark a folder as complete."""
    (folder / ".dermis-lock").write_text(zips.digest(lock), encoding="utf-8")


def pip(python: Path, verb: str, *arguments: str) -> None:
    """Run pip on wheels whose hashes are pinned."""
    fixed = ["--quiet", "--disable-pip-version-check", "--no-input", "--require-hashes", "--only-binary=:all:"]
    quietly([str(python), "-m", "pip", verb, *fixed, *arguments], f"pip {verb} failed")


def install_into(folder: Path, lock: Path, python: Path, *more: str) -> None:
    """Install what a list pins into a folder of its own, anew."""
    shutil.rmtree(folder, ignore_errors=True)
    pip(python, "install", *more, "--no-deps", "--target", str(folder), "-r", str(lock))
    stamp(folder, lock)


def quietly(command: list[str], problem: str) -> str:
    """Run a command and return what it printed; show that only where it fails."""
    variables = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run(command, cwd=ROOT, env=variables, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode:
        raise Stop(f"{problem}:\n  {' '.join(command)}\n{done.stdout[-4000:]}")
    return done.stdout


def wheel_folder(python: Path, target: str, version: str) -> Path:
    """Download the pinned wheels of one platform and Python once; every use checks their hashes again."""
    folder = VENV / "wheels" / f"{target}-cp{version.replace('.', '')}"
    if not fresh(folder, WHEELS):
        say(f"downloading wheels for {target}, Python {version}")
        folder.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix="part-", dir=folder.parent))
        try:
            tags = [word for tag in PLATFORMS[target] for word in ("--platform", tag)]
            target_python = ("--implementation", "cp", "--python-version", version)
            pip(python, "download", "--no-deps", *target_python, *tags, "-d", str(part), "-r", str(WHEELS))
            stamp(part, WHEELS)
            shutil.rmtree(folder, ignore_errors=True)
            os.replace(part, folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    pinned = WHEELS.read_text(encoding="utf-8")
    for wheel in folder.glob("*.whl"):
        if zips.digest(wheel) not in pinned:
            raise Stop(f"{wheel} is not the pinned file: delete {folder} and try again.")
    return folder


# -- the kernels ------------------------------------------------------------------------------------------------------


def library(target: str, python: Path) -> Path:
    """Return a platform's compiled library: this machine's where the engine finds it, others in .venv/kernels.

    It is compiled where it is not there yet.

    Args:
        python: one that has pip, to bring the compiler with.
    """
    folder = building.FOLDER if target == building.this_platform() else VENV / "kernels" / building.digest()
    path: Path | None = building.found(target, folder)
    if path is None or not building.whole(path):
        zig = compiler(python)
        say(f"compiling the kernels for {target}")
        try:
            path = building.build(target, folder, [str(zig)], VENV / "zig-cache")
        except building.NotBuilt as problem:
            raise Stop(str(problem)) from problem
    assert path is not None
    return path


def compiler(python: Path) -> Path:
    """Return the pinned compiler; two lines of tests may bring it at once, and the first one stays."""
    folder = VENV / "zig"
    if not fresh(folder, KERNELS):
        say("downloading the compiler of the kernels (100 MB)")
        VENV.mkdir(exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix="zig-part-", dir=VENV))
        try:
            install_into(part, KERNELS, python)
            if not fresh(folder, KERNELS):
                shutil.rmtree(folder, ignore_errors=True)
                os.replace(part, folder)
        except OSError:
            if not fresh(folder, KERNELS):
                raise
        finally:
            shutil.rmtree(part, ignore_errors=True)
    return folder / "ziglang" / ("zig.exe" if os.name == "nt" else "zig")


def kernels_wheel(target: str, python: Path) -> Path:
    """Return the wheel that brings a platform's library to Blender, made where it is not there yet.

    Its version ends with the digest of the sources: Blender keeps an installed wheel of the same name.
    """
    path = library(target, python)
    version = f"{zips.manifest_value('version')}.{int(building.digest(), 16)}"
    tag = f"py3-none-{building.TARGETS[target].tag}"
    wheel: Path = VENV / "wheels" / "kernels" / f"dermis_kernels-{version}-{tag}.whl"
    zips.write_kernels_wheel(wheel, path, version, tag)
    return wheel


# -- the zip ----------------------------------------------------------------------------------------------------------


def build_zip(python: Path, folder: Path, target: str | None, version: str | None) -> Path:
    """Build the zip of one platform and Python, or the one without wheels where both are None.

    Blender's own validator judges it where Blender is at hand as a module; the tests always have it.
    """
    wheels = {}
    if target is not None and version is not None:
        own = kernels_wheel(target, python)
        wheels = {wheel.name: wheel for wheel in (*wheel_folder(python, target, version).glob("*.whl"), own)}
    path: Path = folder / zips.zip_name(target, version)
    zips.write_zip(path, target, version, wheels)
    for folder in VENV.glob("cp3??"):
        for validator in folder.rglob("bl_pkg/cli/blender_ext.py"):
            command = [str(inside(folder)), str(validator), "validate", str(path)]
            quietly(command, f"Blender's validator refuses {path.name}")
    return path


def tool_python() -> Path:
    """Return a Python that has pip, to download wheels with: this one, or one made for it."""
    if printed(sys.executable, "-m", "pip", "--version"):
        return Path(sys.executable)
    folder = VENV / "tools"
    python = inside(folder)
    if not printed(str(python), "-m", "pip", "--version"):
        if not can_make_environments():
            need_packages(["python3-pip"], "This Python has no pip to download wheels with")
            return Path(sys.executable)
        quietly([sys.executable, "-m", "venv", "--clear", str(folder)], "The environment could not be made")
    return python


# -- the verbs --------------------------------------------------------------------------------------------------------


def build(options: argparse.Namespace) -> int:
    """Build the zips, and beside them the index of a repository, checksums and notes, into dist/: with any Python, and
    without downloading Blender.
    """
    python = tool_python()
    versions = sorted({*DEFAULT_PYTHONS, *options.python}, key=PINNED_PYTHONS.index)
    chosen = [(target, version) for target in options.platform or PLATFORMS for version in versions]
    for target, version in [(None, None)] if options.no_wheels else chosen:
        path = build_zip(python, options.out, target, version)
        say(f"{path}  {path.stat().st_size / 1e6:.1f} MB  sha256 {zips.digest(path)}")
    released = zips.released(options.out)
    if not released:
        return 0
    texts = {zips.INDEX: zips.index(released), zips.SUMS: zips.sums(released), zips.NOTES: zips.release_notes(released)}
    for name, text in texts.items():
        (options.out / name).write_bytes(text.encode())
        say(f"{options.out / name}")
    return 0


def kernels(options: argparse.Namespace) -> int:
    """Compile core/kernels for this machine, where the engine finds it, or for the platforms that are named."""
    python = tool_python()
    for target in options.platform or [this_platform()]:
        path = library(target, python)
        say(f"{path}  {path.stat().st_size / 1e3:.0f} kB  sha256 {zips.digest(path)}")
    return 0


def test(options: argparse.Namespace) -> int:
    """Run ruff, mypy (on 3.13) and the three levels of tests; judge by pytest's own counts."""
    env = environment()
    if options.mutate:
        return mutate(env, options)
    started = time.monotonic()
    paths = [a for a in options.pytest if not a.startswith("-") and (ROOT / a.split("::")[0]).exists()]
    others = [a for a in options.pytest if a not in paths] + (["--long"] if options.long else [])
    failed = [] if paths else lint(env)
    counts = {"passed": 0, "failed": 0, "skipped": 0}
    with tempfile.TemporaryDirectory(prefix="dermis-test-") as scratch:
        for level in LEVELS:
            mine = [p for p in paths if f"tests/{level}" in Path(p).as_posix()] if paths else [f"tests/{level}"]
            if not mine or not (ROOT / "tests" / level).is_dir():
                continue
            passed = level_passed(env, level, mine + others, Path(scratch), counts)
            if level == "blender":
                passed &= level_passed(env, level, mine + others, Path(scratch), counts, undo=True)
            if not passed:
                failed.append(level)
    if not counts["passed"] and not failed:
        failed.append("no test ran")
    if failed:
        say(f"FAILED: {', '.join(failed)}")
    line = f"Python {platform.python_version()}, Blender {BLENDER[sys.version_info[:2]]}"
    say(f"{line}: {time.monotonic() - started:.0f} s")
    say(f"total: {counts['passed']} passed, {counts['failed']} failed, {counts['skipped']} skipped")
    return 1 if failed else 0


def mutate(env: Environment, options: argparse.Namespace) -> int:
    """Change one thing of the engine at a time and say which changes no test notices."""
    numbers = [str(options.mutate), "--seed", str(options.seed), "--jobs", str(options.jobs)]
    below = [word for path in options.pytest for word in ("--below", path)]
    command = [str(env.python), "-m", "tests.mutate", *numbers, *below]
    return subprocess.run(command, cwd=ROOT, env=env.variables(True)).returncode


def lint(env: Environment) -> list[str]:
    """Run the checkers; return the names of those that found something."""
    failed = []
    for name, command in (
        ("ruff", ["ruff", "check", "--output-format=concise", "."]),
        ("ruff format", ["ruff", "format", "--check", "."]),
        ("mypy", ["mypy"]),
    ):
        if name == "mypy" and sys.version_info[:2] != (3, 13):
            continue
        say(f"== {name}")
        if subprocess.run([str(env.python), "-m", *command], cwd=ROOT, env=env.variables(False)).returncode:
            failed.append(name)
    return failed


def level_passed(
    env: Environment, level: str, arguments: list[str], scratch: Path, counts: dict[str, int], *, undo: bool = False
) -> bool:
    """Run pytest on one level in a process of its own and add to the counts; of Blender's, without or with undo."""
    say(f"== {level}" + ", undo" * undo)
    report = scratch / f"{level}{'-undo' * undo}.xml"
    command = [str(env.python), "-m", "pytest", f"--junitxml={report}", "-o", "junit_family=xunit2", "-q"]
    command += ["--durations=25", "--durations-min=5"]  # what a person waits for
    if level == "blender":
        command += ["-m", "undo" if undo else "not undo"]
    more = {"BLENDER_USER_RESOURCES": str(scratch / f"{level}-profile"), **KEPT_MEMORY}
    if level == "unit":
        more["PYTHONPATH"] = os.pathsep.join(map(str, (env.wheels, *beside(env, "dask", "sweep", "boards"))))
    if level == "extension":  # nothing of the source tree may be importable: the installed zip is on trial
        command += ["-o", "pythonpath=tests/extension"]
        more["DERMIS_ZIP"] = str(build_zip(env.python, scratch, this_platform(), this_python()))
    variables = env.variables(level != "extension", **more)
    for tries in reversed(range(UNDO_TRIES if undo else 1)):
        try:
            status = subprocess.run(command + arguments, cwd=ROOT, env=variables, timeout=LEVEL_LIMIT).returncode
        except subprocess.TimeoutExpired:
            say(f"{level}: no end after {LEVEL_LIMIT // 60} minutes")
            return False
        if status >= 0 or not tries:
            break
        say(f"{level}: BLENDER DIED in its undo (signal {-status}); its tests are run again")
    if not report.is_file():
        say(f"{level}: pytest ended with status {status} and no report")
        return False
    seen = {"tests": 0, "failures": 0, "errors": 0, "skipped": 0}
    for suite in ElementTree.parse(report).getroot().iter("testsuite"):
        for key in seen:
            seen[key] += int(suite.get(key, "0"))
    bad = seen["failures"] + seen["errors"]
    counts["failed"] += bad
    counts["skipped"] += seen["skipped"]
    counts["passed"] += seen["tests"] - bad - seen["skipped"]
    return not bad and status in (0, 5)  # 5: none selected, which the total judges


def demo(options: argparse.Namespace) -> int:
    """Build the zip, install it as a user would, bake the demo scene and export its tracks."""
    seconds: dict[str, float] = {}
    started = time.monotonic()
    env = environment()
    seconds["environment"] = time.monotonic() - started
    started = time.monotonic()
    path = build_zip(env.python, DIST, this_platform(), this_python())
    seconds["zip"] = time.monotonic() - started
    out = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    profile = VENV / f"demo-profile-{env.python.parents[1].name}"
    shutil.rmtree(profile, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix="dermis-demo-") as scratch:
        report = Path(scratch) / "report.json"
        script = ROOT / "tests" / "extension" / "walkthrough.py"
        command = [str(env.python), str(script), str(path), str(out), "--report", str(report)]
        done = subprocess.run(command, cwd=scratch, env=env.variables(False, BLENDER_USER_RESOURCES=str(profile)))
        if done.returncode or not report.is_file():
            raise Stop(f"The demo did not finish (status {done.returncode}); what Blender said is above.")
        told = json.loads(report.read_text(encoding="utf-8"))
    seconds.update(told["seconds"])
    say(f"\nWritten to {out}:")
    for name in told["written"]:
        say(f"  {name:44} {(out / name).stat().st_size / 1e3:9.1f} kB")
    say("Time:")
    for stage, value in seconds.items():
        say(f"  {stage:44} {value:9.2f} s")
    say(f"\nTo open the scene in Blender {BLENDER[sys.version_info[:2]]}:")
    say(f"  1. Preferences > Get Extensions > Install from Disk: {path}")
    say(f"  2. File > Open: {out / told['scene']}")
    say("  3. Press N in the 3D view and choose the Dermis tab; scrub the timeline.")
    return 0


def bench(options: argparse.Namespace) -> int:
    """Run the benchmarks, print the table and write the JSON."""
    env = environment()
    with tempfile.TemporaryDirectory(prefix="dermis-bench-") as scratch:
        path = build_zip(env.python, Path(scratch), this_platform(), this_python())
        command = [str(env.python), "-m", "tests.benchmarks", *options.names]
        if options.json:
            command += ["--json", str(options.json.resolve())]
        if options.full:
            command += ["--full", "--out", str(options.out.resolve())]
        more = {"DERMIS_ZIP": str(path), "BLENDER_USER_RESOURCES": str(Path(scratch) / "profile")}
        more["PYTHONPATH"] = os.pathsep.join(map(str, (env.wheels, *beside(env, "peers", "mujoco", "dask", "boards"))))
        return subprocess.run(command, cwd=ROOT, env=env.variables(True, **more)).returncode


def stress(options: argparse.Namespace) -> int:
    """Hold scenes, surfaces, pins and mechanisms drawn at random to the laws they must obey; print the table."""
    env = environment()
    given = {"--seconds": options.seconds, "--runs": options.runs, "--seed": options.seed, "--json": options.json}
    given |= {"--workers": options.workers, "--scheduler": options.scheduler}
    words = [word for name, value in given.items() if value is not None for word in (name, value)]
    words += [word for value in options.set or () for word in ("--set", value)]
    command = [str(env.python), "-m", "tests.stress", *options.names, *words]
    more = beside(env, "dask") if options.scheduler else []
    path = os.pathsep.join(map(str, (env.wheels, *more)))
    return subprocess.run(command, cwd=ROOT, env=env.variables(True, PYTHONPATH=path)).returncode


def beside(env: Environment, *names: str) -> list[Path]:
    """Make (or keep) the folders of lists that tests and benchmarks can do without; the extension has none of them."""
    folders = []
    for name in names:
        folder, lock = VENV / f"{env.python.parents[1].name}-{name}", LOCKS / f"{name}.txt"
        try:
            if not fresh(folder, lock):
                install_into(folder, lock, env.python)
            folders.append(folder)
        except Stop as problem:
            say(f"WARNING: going on without what .ci/{name}.txt lists: {problem}")
    return folders


def dev(options: argparse.Namespace) -> int:
    """Link the sources into a Blender profile, so that an edit is live after Reload Scripts."""
    profile = options.profile or (own_profile(options.blender) if options.blender else VENV / "dev-profile")
    wheels: dict[str, Path] = {}
    python = tool_python()
    library(this_platform(), python)  # beside its sources, which are linked
    if not options.no_wheels:
        for version in sorted({*DEFAULT_PYTHONS, *options.python}):
            wheels.update({p.name: p for p in wheel_folder(python, this_platform(), version).glob("*.whl")})
    package = profile.resolve() / "extensions" / "user_default" / zips.manifest_value("id")
    if package.exists() and not (package / ".dermis-dev").exists():
        raise Stop(f"{package} holds an installed Dermis: uninstall it in Blender first.")
    unlink_tree(package)
    package.mkdir(parents=True)
    (package / ".dermis-dev").touch()
    text = zips.manifest(this_platform() if wheels else None, None, list(wheels))
    (package / "blender_manifest.toml").write_text(text, encoding="utf-8", newline="\n")
    for source in [*(ROOT / "blender_addon").iterdir(), ROOT / "core", ROOT / "presets", ROOT / "LICENSE"]:
        if source != zips.TEMPLATE and source.name != "__pycache__" and source.exists():
            link(source, package / source.name)
    if wheels:
        (package / "wheels").mkdir()
        for name, wheel in wheels.items():
            shutil.copyfile(wheel, package / "wheels" / name)
    say(f"linked into {package}")
    if not options.blender:
        say(f"start Blender with BLENDER_USER_RESOURCES={profile.resolve()}")
    say("enable Dermis in Preferences > Add-ons; after an edit: F3, Reload Scripts. New files need `dev` again.")
    return 0


def docs(options: argparse.Namespace) -> int:
    """Write API.md from the engine's docstrings, PARAMETERS.md from its tables, COMMANDS.md from its command line."""
    env = environment()
    for name, maker in DOCS.items():
        path = options.out.resolve() / name
        quietly([str(env.python), *maker, str(path)], "The page could not be written")
        say(f"{path}  {path.stat().st_size / 1e3:.0f} kB")
    return site(env, options.site) if options.site else 0


def site(env: Environment, folder: Path) -> int:
    """Build the site of all pages with MkDocs, which is brought; 1 where it warns, such as of a broken link."""
    tools = VENV / f"{env.python.parents[1].name}-site"
    if not fresh(tools, LOCKS / "site.txt"):
        say("downloading MkDocs")
        install_into(tools, LOCKS / "site.txt", env.python)
    command = [str(env.python), str(LOCKS / "site_pages.py"), str(folder.resolve())]
    status = subprocess.run(command, cwd=ROOT, env=env.variables(False, PYTHONPATH=str(tools))).returncode
    say(f"open {folder.resolve() / 'index.html'}" if not status else "the site has warnings")
    return status


def own_profile(version: str) -> Path:
    """Return the folder where a Blender of this version keeps its user's files."""
    base = {
        "win32": Path(os.environ.get("APPDATA", Path.home())) / "Blender Foundation" / "Blender",
        "darwin": Path.home() / "Library" / "Application Support" / "Blender",
    }.get(sys.platform, Path(os.environ.get("XDG_CONFIG_HOME", Path.home() / ".config")) / "blender")
    return base / version


def link(source: Path, target: Path) -> None:
    """Link a file or folder; where Windows forbids links, use a junction, a hard link, or at last a copy."""
    try:
        target.symlink_to(source, target_is_directory=source.is_dir())
    except OSError:
        if source.is_dir():
            if subprocess.run(["cmd", "/c", "mklink", "/J", str(target), str(source)], stdout=-3, stderr=-3).returncode:
                shutil.copytree(source, target)
                say(f"copied {source.name}: links are not allowed here, so run `dev` after every edit")
        else:
            try:
                os.link(source, target)
            except OSError:
                shutil.copyfile(source, target)


def unlink_tree(folder: Path) -> None:
    """Remove a folder of links without following any."""
    if folder.is_dir():
        for entry in folder.iterdir():
            if entry.is_symlink() or entry.is_file():
                entry.unlink()
            else:
                try:
                    entry.rmdir()  # a junction, or empty
                except OSError:
                    shutil.rmtree(entry)
        folder.rmdir()


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    top = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = top.add_subparsers(dest="verb", metavar="VERB", required=True)

    def verb(function: Any, **more: Any) -> argparse.ArgumentParser:
        made: argparse.ArgumentParser = verbs.add_parser(
            function.__name__, help=function.__doc__, description=function.__doc__, **more
        )
        made.set_defaults(function=function)
        return made

    new = verb(demo)
    new.add_argument("--out", type=Path, default=ROOT / "demo_out", metavar="DIR", help="where to write (demo_out/)")
    new = verb(test, epilog="Anything else goes to pytest: paths, -k WORDS, -x ...")
    new.add_argument("--long", action="store_true", help="also run the tests that take minutes")
    new.add_argument(
        "--mutate", type=int, metavar="N", help="instead, make N changes of core (or of the paths given), one by one"
    )
    new.add_argument("--seed", type=int, default=0, metavar="S", help="of the draw of --mutate (0)")
    new.add_argument("--jobs", type=int, default=1, metavar="J", help="mutants at a time (1)")
    new = verb(build)
    new.add_argument("--out", type=Path, default=DIST, metavar="DIR", help="where to write (dist/)")
    new.add_argument("--platform", action="append", choices=list(PLATFORMS), help="this platform only (repeatable)")
    more_pythons: dict[str, Any] = {
        "action": "append",
        "choices": PINNED_PYTHONS,
        "default": [],
        "help": "for this Python too, beside 3.11 and 3.13 (repeatable)",
    }
    new.add_argument("--python", **more_pythons)
    new.add_argument("--no-wheels", action="store_true", help="one zip without wheels, for tests")
    new = verb(kernels)
    new.add_argument("--platform", action="append", choices=list(PLATFORMS), help="this platform (repeatable)")
    new = verb(dev)
    where = new.add_mutually_exclusive_group()
    where.add_argument("--blender", metavar="VERSION", help="your own profile of this Blender, such as 5.2")
    where.add_argument("--profile", type=Path, metavar="DIR", help="another profile (default: .venv/dev-profile)")
    new.add_argument("--python", **more_pythons)
    new.add_argument("--no-wheels", action="store_true", help="do not bring scipy and the other libraries")
    new = verb(bench)
    new.add_argument("names", nargs="*", metavar="NAME", help="benchmarks to run (default: the quick ones)")
    new.add_argument("--json", type=Path, metavar="FILE", help="write the results to this file")
    new.add_argument(
        "--full", action="store_true", help="all, and time against error, knob by knob: tables, JSON, diagrams"
    )
    new.add_argument("--out", type=Path, default=ROOT / "bench_out", metavar="DIR", help="of --full (bench_out/)")
    new = verb(stress)
    new.add_argument("names", nargs="*", metavar="NAME", help="kinds of cases (default: all but 'invariance_*')")
    how = new.add_mutually_exclusive_group()
    how.add_argument("--seconds", metavar="N", help="for so long, each kind as long as any other")
    how.add_argument("--runs", metavar="N", help="cases of each kind (20)")
    new.add_argument("--seed", metavar="S", help="of the first case of each kind (one that nobody has seen)")
    new.add_argument("--workers", metavar="N", help="processes that judge cases, with --runs (none: this one)")
    new.add_argument("--scheduler", metavar="URL", help="a dask scheduler's workers judge them, with --runs")
    new.add_argument("--set", action="append", metavar="NAME=VALUE", help="in place of what is drawn (repeatable)")
    new.add_argument("--json", type=os.path.abspath, metavar="FILE", help="write the results to this file")
    new = verb(docs)
    new.add_argument("--out", type=Path, default=ROOT / "core", metavar="DIR", help="where to write (core/)")
    new.add_argument("--site", type=Path, metavar="DIR", help="also build a site of all pages, with search")
    return top


def main(arguments: list[str]) -> int:
    """Do what the command line says; a refusal is one clear message and status 1."""
    options, rest = parser().parse_known_args(arguments)
    if rest and options.verb != "test":
        parser().error(f"unknown arguments: {' '.join(rest)}")
    options.pytest = rest
    try:
        status: int | None = None if options.function in (build, dev, kernels) else with_python(arguments)
        return options.function(options) if status is None else status
    except Stop as refusal:
        print(f"build_addon.py: {refusal}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("build_addon.py: stopped", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
