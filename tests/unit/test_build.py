"""build_addon.py: what goes into the zip, the same bytes twice, pinned packages, and clear refusals."""

from __future__ import annotations

import ast
import base64
import ctypes
import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import NamedTuple

import pytest

import build_addon

zips = build_addon.zips
ROOT = Path(__file__).resolve().parents[2]
LOCKS = sorted((ROOT / ".ci").glob("*.txt"))
needs_shell = pytest.mark.skipif(os.name == "nt", reason="the commands are shell scripts")


@pytest.fixture
def wheels(tmp_path: Path) -> dict[str, Path]:
    """Two files that stand for wheels."""
    made = {}
    for name in ("scipy-1.17.1-cp313-cp313-win_amd64.whl", "pyserial-3.5-py2.py3-none-any.whl"):
        path = tmp_path / name
        path.write_bytes(name.encode())
        made[name] = path
    return made


def test_zip_is_the_same_bytes_twice(tmp_path: Path, wheels: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = tmp_path / "a.zip", tmp_path / "b.zip"
    zips.write_zip(first, "windows-x64", "3.13", wheels)
    files = zips.sources()
    monkeypatch.setattr(zips, "sources", lambda: dict(reversed(files.items())))
    os.utime(wheels["scipy-1.17.1-cp313-cp313-win_amd64.whl"], (1e9, 1e9))
    zips.write_zip(second, "windows-x64", "3.13", dict(reversed(wheels.items())))
    assert hashlib.sha256(first.read_bytes()).digest() == hashlib.sha256(second.read_bytes()).digest()


def test_zip_holds_addon_engine_presets_and_licence(tmp_path: Path, wheels: dict[str, Path]) -> None:
    path = tmp_path / "a.zip"
    zips.write_zip(path, "windows-x64", "3.13", wheels)
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        names = archive.namelist()
        for name, source in (
            ("_core.py", "blender_addon/_core.py"),
            ("core/units.py", "core/units.py"),
            ("LICENSE", "LICENSE"),
        ):
            assert archive.read(name) == (ROOT / source).read_bytes()
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
        infos = archive.infolist()
    presets = {f"presets/{p.relative_to(ROOT / 'presets').as_posix()}" for p in (ROOT / "presets").rglob("*.json")}
    assert presets <= set(names)
    assert names == sorted(names) and len(set(names)) == len(names)
    assert {i.date_time for i in infos} == {(1980, 1, 1, 0, 0, 0)}
    assert not [n for n in names if "__pycache__" in n or n.endswith(".pyc") or "/." in n or "numpy" in n]
    assert {"core/kernels/kernels.h", "core/kernels/closest.c"} <= set(names), "what was compiled can be read"
    assert not [n for n in names if n.endswith(zips.LIBRARIES)], "compiled code comes in a wheel"
    assert {f"./{n}" for n in names if n.startswith("wheels/")} == set(manifest["wheels"])
    assert manifest["platforms"] == ["windows-x64"]


def test_the_kernels_come_in_a_wheel_for_every_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same bytes twice, every file in its record, named by the sources: Blender keeps a wheel of the same name."""
    folder = tmp_path / "kernels" / build_addon.building.digest()
    for target, of in build_addon.building.TARGETS.items():
        folder.mkdir(parents=True, exist_ok=True)
        stem, content = build_addon.building.stem(target), build_addon.building.of_content(target.encode())
        (folder / f"{stem}{content}{of.suffix}").write_bytes(target.encode())
    monkeypatch.setattr(build_addon, "VENV", tmp_path)
    monkeypatch.setattr(build_addon.building, "this_platform", lambda: "none of them")
    monkeypatch.setattr(build_addon, "compiler", lambda python: pytest.fail("it is there"))
    for target, of in build_addon.building.TARGETS.items():
        wheel = build_addon.kernels_wheel(target, Path("python"))
        before = wheel.read_bytes()
        assert build_addon.kernels_wheel(target, Path("python")).read_bytes() == before
        name, version, *tags = wheel.stem.split("-")
        assert (name, tags) == ("dermis_kernels", ["py3", "none", of.tag]) and of.tag in build_addon.PLATFORMS[target]
        assert version == f"{zips.manifest_value('version')}.{int(build_addon.building.digest(), 16)}"
        with zipfile.ZipFile(wheel) as archive:
            names = archive.namelist()
            rows = archive.read(f"dermis_kernels-{version}.dist-info/RECORD").decode().splitlines()
            for row in rows[:-1]:
                path, sha, size = row.split(",")
                content = archive.read(path)
                told = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")
                assert (sha, size) == (f"sha256={told}", str(len(content)))
            assert sorted(row.split(",")[0] for row in rows) == names
            assert archive.read(next(n for n in names if n.endswith(of.suffix))) == target.encode()


def test_the_compiler_of_pip_is_that_of_the_zip() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    pinned = re.findall(r"^(ziglang==\S+)", build_addon.KERNELS.read_text(encoding="utf-8"), re.M)
    assert len(pinned) == 1 and pinned[0] in project["build-system"]["requires"]


def test_manifest_differs_from_the_template_by_what_one_zip_is_for() -> None:
    template = tomllib.loads(zips.TEMPLATE.read_text(encoding="utf-8"))
    wheels = {"platforms": ["linux-x64"], "wheels": ["./wheels/a.whl", "./wheels/b.whl"]}
    for python, line in (
        ("3.11", {"blender_version_min": "4.5.0", "blender_version_max": "5.1.0"}),
        ("3.13", {"blender_version_min": "5.1.0"}),
        ("3.14", {"blender_version_min": "4.5.0"}),
    ):
        assert tomllib.loads(zips.manifest("linux-x64", python, ["b.whl", "a.whl"])) == {**template, **wheels, **line}
    assert tomllib.loads(zips.manifest("linux-x64", None, ["b.whl", "a.whl"])) == {**template, **wheels}
    assert tomllib.loads(zips.manifest(None, None, [])) == template


@pytest.mark.parametrize(
    ("target", "python", "name"),
    [
        ("windows-x64", "3.11", "dermis-{}-blender4.5-windows-x64.zip"),
        ("macos-arm64", "3.13", "dermis-{}-blender5.2-macos-arm64.zip"),
        ("linux-x64", "3.14", "dermis-{}-python3.14-linux-x64.zip"),
        (None, None, "dermis-{}.zip"),
    ],
)
def test_a_zip_is_named_by_what_it_is_for(target: str | None, python: str | None, name: str) -> None:
    assert zips.zip_name(target, python) == name.format(zips.manifest_value("version"))


def test_every_python_that_tests_run_on_has_a_line_of_blender() -> None:
    assert set(zips.LINES) == set(build_addon.DEFAULT_PYTHONS)
    assert set(build_addon.PLATFORMS) == set(build_addon.building.TARGETS)


def test_a_zip_that_is_too_large_is_refused(
    tmp_path: Path, wheels: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zips, "MOST_BYTES", 1_000_000)
    with pytest.raises(build_addon.Stop, match=r"MB, and 1 are allowed"):
        zips.write_zip(tmp_path / "a.zip", "windows-x64", "3.13", wheels)


@pytest.fixture
def released(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with small zips of this version for two platforms and lines, an older one and one without wheels."""
    folder, few = tmp_path / "dist", {"LICENSE": ROOT / "LICENSE", "__init__.py": ROOT / "blender_addon/__init__.py"}
    monkeypatch.setattr(zips, "sources", lambda: few)
    for target, tag in (("linux-x64", "manylinux_2_28_x86_64"), ("windows-x64", "win_amd64")):
        for python in ("3.11", "3.13"):
            cp = f"cp{python.replace('.', '')}"
            wheels = {}
            for name in (f"scipy-1.17.1-{cp}-{cp}-{tag}.whl", "pyserial-3.5-py2.py3-none-any.whl"):
                wheels[name] = tmp_path / name
                wheels[name].write_bytes(name.encode())
            zips.write_zip(folder / zips.zip_name(target, python), target, python, wheels)
    zips.write_zip(folder / zips.zip_name(None, None), None, None, {})
    (folder / "dermis-0.0.1-blender4.5-linux-x64.zip").write_bytes(b"an older one")
    return folder


def test_the_index_is_the_one_that_blender_would_write(released: Path, tmp_path: Path) -> None:
    """Judged by Blender's own generator of listings, which also says where two zips would be offered to one Blender."""
    made = zips.released(released)
    assert len(made) == 4
    copied = tmp_path / "copied"
    copied.mkdir()
    for path in made:
        shutil.copyfile(path, copied / path.name)
    (generator,) = (Path(sys.prefix) / "lib").rglob("bl_pkg/cli/blender_ext.py")
    told = subprocess.run(
        [sys.executable, str(generator), "server-generate", "--repo-dir", str(copied)], capture_output=True, text=True
    )
    assert told.returncode == 0 and "duplicates" not in told.stdout + told.stderr, told
    blenders, ours = json.loads((copied / "index.json").read_text()), json.loads(zips.index(made))
    assert sorted(blenders.pop("data"), key=lambda row: row["archive_url"]) == ours.pop("data")
    assert blenders == ours
    assert zips.index(made) == zips.index(zips.released(released))


def test_checksums_are_what_is_checked_with(released: Path) -> None:
    made = zips.released(released)
    (released / zips.SUMS).write_text(zips.sums(made))
    rows = [row.split("  ") for row in (released / zips.SUMS).read_text().splitlines()]
    assert rows == [[hashlib.sha256(path.read_bytes()).hexdigest(), path.name] for path in made]
    if shutil.which("sha256sum"):
        subprocess.run(["sha256sum", "--check", "--strict", zips.SUMS], cwd=released, check=True, capture_output=True)
        made[0].write_bytes(b"changed")
        done = subprocess.run(["sha256sum", "--check", zips.SUMS], cwd=released, capture_output=True)
        assert done.returncode != 0


def test_manifest_says_what_blender_asks_for() -> None:
    template = tomllib.loads(zips.TEMPLATE.read_text(encoding="utf-8"))
    assert template["id"] == "dermis" and template["license"] == ["SPDX:GPL-3.0-or-later"]
    assert re.fullmatch(r"\d+\.\d+\.\d+", template["version"])
    assert set(template["permissions"]) <= {"files", "network", "clipboard", "camera", "microphone"}
    for reason in (*template["permissions"].values(), template["tagline"]):
        assert 0 < len(reason) <= 64 and not reason.endswith(".")


def test_licence_is_the_gpl() -> None:
    text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert "GNU GENERAL PUBLIC LICENSE" in text and "Version 3, 29 June 2007" in text
    assert "15. Disclaimer of Warranty." in text and "END OF TERMS AND CONDITIONS" in text


@pytest.mark.parametrize("lock", LOCKS, ids=lambda p: p.name)
def test_every_package_is_pinned_and_hashed_and_comes_from_nowhere_in_particular(lock: Path) -> None:
    text = lock.read_text(encoding="utf-8")
    assert "://" not in text and not re.search(r"^\s*(-i|-f|--index|--extra|--find|--trusted)", text, re.M)
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    entries = "\n".join(lines).replace("\\\n", " ").split("\n")
    for entry in entries:
        assert re.fullmatch(r"[A-Za-z0-9._-]+==[^\s;]+(\s*;[^\\]*?)?(\s+--hash=sha256:[0-9a-f]{64})+", entry), entry


def test_scipy_stays_out_of_blenders_environment_and_numpy_out_of_the_zip() -> None:
    names = {
        lock.name: {m.group(1).lower() for m in re.finditer(r"^([\w.-]+)==", lock.read_text(), re.M)} for lock in LOCKS
    }
    assert names["wheels.txt"] == {"scipy", "onnxruntime", "pillow", "pyserial", "threadpoolctl"}
    for tag in ("cp311", "cp313"):
        assert {"bpy", "numpy", "pytest", "ruff"} <= names[f"environment-{tag}.txt"]
        assert not names[f"environment-{tag}.txt"] & names["wheels.txt"]


def test_build_addon_needs_the_standard_library_only() -> None:
    roots = set()
    files = (ROOT / "build_addon.py", ROOT / ".ci" / "zips.py")
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in files]
    for node in (node for tree in trees for node in ast.walk(tree)):
        if isinstance(node, ast.Import):
            roots |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level
            roots.add((node.module or "").partition(".")[0])
    assert roots <= sys.stdlib_module_names | {"__future__"}


@pytest.mark.parametrize("verb", ["", "demo", "test", "build", "kernels", "dev", "bench", "stress", "docs"])
def test_help_everywhere(verb: str) -> None:
    done = run(*verb.split(), "--help")
    assert done.returncode == 0 and "usage:" in done.stdout


@pytest.mark.parametrize("arguments", [["fly"], ["build", "--fast"], ["build", "--python", "3.12"], []])
def test_what_it_does_not_know_is_refused(arguments: list[str]) -> None:
    assert run(*arguments).returncode == 2


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run build_addon.py in a process of its own."""
    return subprocess.run([sys.executable, str(ROOT / "build_addon.py"), *arguments], capture_output=True, text=True)


class Other(NamedTuple):
    """Another Python's version."""

    major: int = 3
    minor: int = 12
    micro: int = 1


@pytest.fixture
def twelve(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Let this be Python 3.12 with nothing else at hand; return the home folder."""
    monkeypatch.setattr(sys, "version_info", Other())
    monkeypatch.setattr(platform, "python_version", lambda: "3.12.1")
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    for name in ("PYENV_ROOT", "CONDA_PREFIX"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    (tmp_path / "bin").mkdir()
    return tmp_path


def script(path: Path, text: str) -> None:
    """Write a shell script that can be run."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


PYTHON = 'case "$1" in -c) echo cpython 3 13;; *) echo "went on: $@"; exit 7;; esac'


@needs_shell
def test_without_a_python_that_will_do_a_sentence_says_what_to_install(
    twelve: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert build_addon.main(["demo"]) == 1
    said = capfd.readouterr().err
    assert "3.11" in said and "3.13" in said and "3.12.1" in said and "uv python install 3.13" in said
    assert said.count("\n") == 1


@needs_shell
@pytest.mark.parametrize(
    "place", ["bin/python3.13", ".pyenv/versions/3.13.0/bin/python", "miniconda3/envs/blender/bin/python"]
)
def test_another_python_goes_on_with_one_that_will_do(
    place: str, twelve: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    script(twelve / "bin" / "python3.11", "echo 'python3.11: not installed here' >&2; exit 127")  # a shim
    script(twelve / place, PYTHON)
    assert build_addon.main(["test", "-k", "two words"]) == 7
    said = capfd.readouterr().out
    assert f"went on: {build_addon.ROOT / 'build_addon.py'} test -k two words" in said and place in said


@needs_shell
def test_uv_brings_a_python(twelve: Path, capfd: pytest.CaptureFixture[str]) -> None:
    script(twelve / "uv" / "python", PYTHON)
    mark = twelve / "fetched"
    fetch, find = f'[ "$2" = install ] && : > "{mark}" && exit 0', f'[ -e "{mark}" ] && echo "{twelve}/uv/python"'
    script(twelve / "bin" / "uv", f"{fetch}\n{find}")
    assert build_addon.main(["demo"]) == 7
    assert "uv fetches Python 3.13" in capfd.readouterr().out


def test_a_zip_is_built_by_any_python_and_without_blender(twelve: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build_addon, "VENV", twelve / "venv")
    monkeypatch.setattr(build_addon, "environment", lambda: pytest.fail("Blender is downloaded"))
    assert build_addon.main(["build", "--no-wheels", "--out", str(twelve / "dist")]) == 0
    assert len(list((twelve / "dist").glob("dermis-*.zip"))) == 1


@needs_shell
def test_a_command_that_is_no_python_is_not_trusted(tmp_path: Path) -> None:
    shim = tmp_path / "python3.13"
    shim.write_text("#!/bin/sh\necho 'command not found in this version' >&2\nexit 127\n")
    shim.chmod(0o755)
    assert not build_addon.runs(str(shim))
    assert not build_addon.runs(str(tmp_path / "nowhere"))
    assert build_addon.runs(sys.executable)


def test_notes_of_a_release_have_what_is_new_the_files_and_how_to_install(tmp_path: Path) -> None:
    made = [tmp_path / "dermis-9.9.9-blender4.5-linux-x64.zip", tmp_path / "dermis-9.9.9-blender5.2-windows-x64.zip"]
    for i, path in enumerate(made):
        path.write_bytes(bytes(i + 1))
    notes = zips.release_notes(made)
    first = re.search(r"^## .*\n+(?:### .*\n+)?(\* .*)", zips.CHANGES.read_text(encoding="utf-8"), re.M)
    assert first is not None and first.group(1) in notes
    for path in made:
        assert f"| `{path.name}` |" in notes and hashlib.sha256(path.read_bytes()).hexdigest() in notes
    assert notes.startswith("# Dermis ") and notes.count("\n# ") == 0 and "Install from Disk" in notes


def test_notes_are_of_the_version_or_of_what_has_come_since(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    changes = tmp_path / "CHANGELOG.md"
    monkeypatch.setattr(zips, "CHANGES", changes)
    version = zips.manifest_value("version")
    changes.write_text(f"# Changelog\n\n## Unreleased\n\n## {version}, 2000-01-01\n\n* this\n\n## 0.0.1\n\n* that\n")
    notes = zips.release_notes([])
    assert "* this" in notes and "* that" not in notes
    changes.write_text("# Changelog\n\n## 0.0.1\n\n* that\n")
    with pytest.raises(build_addon.Stop, match=re.escape(f"## {version}, DATE")):
        zips.release_notes([])


def test_missing_libraries_are_named_with_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    def load(name: str) -> None:
        if name in ("libXi.so.6", "libSM.so.6"):
            raise OSError(name)

    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", load)
    missing = build_addon.missing_libraries()
    assert missing == ["libXi.so.6", "libSM.so.6"]
    monkeypatch.setattr(build_addon.shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(build_addon.os, "geteuid", lambda: 1000, raising=False)
    with pytest.raises(build_addon.Stop, match="sudo apt-get install -y libxi6 libsm6$"):
        build_addon.need_packages([build_addon.NEEDED_LIBRARIES[name] for name in missing], "Blender needs libraries")
    monkeypatch.setattr(build_addon.shutil, "which", lambda name: None)
    with pytest.raises(build_addon.Stop, match="libxi6 libsm6"):
        build_addon.need_packages(["libxi6", "libsm6"], "Blender needs libraries")


def test_libraries_and_venv_are_asked_for_in_one_command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A bare Debian lacks both; whoever may not install them needs one line to paste, not two rounds."""
    monkeypatch.setattr(build_addon, "VENV", tmp_path)
    monkeypatch.setattr(build_addon, "can_make_environments", lambda: False)
    monkeypatch.setattr(build_addon, "missing_libraries", lambda: ["libXi.so.6", "libGL.so.1"])
    monkeypatch.setattr(build_addon.shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(build_addon.os, "geteuid", lambda: 1000, raising=False)
    python = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    with pytest.raises(build_addon.Stop, match=f"sudo apt-get install -y {python}-venv libxi6 libgl1$"):
        build_addon.environment()


def test_a_wheel_that_changed_on_disk_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build_addon, "VENV", tmp_path)
    folder = tmp_path / "wheels" / "linux-x64-cp311"
    folder.mkdir(parents=True)
    build_addon.stamp(folder, ROOT / ".ci" / "wheels.txt")
    (folder / "scipy-1.17.1-cp311-cp311-linux_x86_64.whl").write_bytes(b"not the pinned wheel")
    with pytest.raises(build_addon.Stop, match="not the pinned file"):
        build_addon.wheel_folder(Path(sys.executable), "linux-x64", "3.11")


def test_an_environment_is_made_again_when_its_list_changes(tmp_path: Path) -> None:
    lock = tmp_path / "lock.txt"
    lock.write_text("a==1\n")
    assert not build_addon.fresh(tmp_path, lock)
    build_addon.stamp(tmp_path, lock)
    assert build_addon.fresh(tmp_path, lock)
    lock.write_text("a==2\n")
    assert not build_addon.fresh(tmp_path, lock)


def test_linking_leaves_the_sources_when_links_are_removed(tmp_path: Path) -> None:
    source, package = tmp_path / "source", tmp_path / "package"
    (source / "inner").mkdir(parents=True)
    (source / "inner" / "kept.py").write_text("kept = True\n")
    package.mkdir()
    build_addon.link(source / "inner", package / "inner")
    build_addon.link(source / "inner" / "kept.py", package / "kept.py")
    assert (package / "inner" / "kept.py").read_text() == "kept = True\n"
    build_addon.unlink_tree(package)
    assert not package.exists() and (source / "inner" / "kept.py").read_text() == "kept = True\n"
