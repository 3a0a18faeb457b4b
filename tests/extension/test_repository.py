"""A folder of zips as Blender's remote repository on loopback: listed, installed, an update offered and taken.

Also updates from disk while the kernels are loaded, and zips that are wrong.
"""

from __future__ import annotations

import importlib.util
import sys
import threading
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import locked_updates
import pytest

ROOT = Path(__file__).resolve().parents[2]
NEWER = "99.0.0"
ADD = """
import bpy, walkthrough
bpy.context.preferences.system.use_online_access = True
repo = bpy.context.preferences.extensions.repos.new(
    name="Lab", module="lab", remote_url=os.environ["LAB"], custom_directory="")
index = list(bpy.context.preferences.extensions.repos).index(repo)
walkthrough.done(bpy.ops.extensions.repo_sync(repo_index=index))
"""
INSTALLED = """
import addon_utils, tomllib
from pathlib import Path
folder = Path(repo.directory) / "dermis"
version = tomllib.loads((folder / "blender_manifest.toml").read_text())["version"]
enabled = addon_utils.check("bl_ext.lab.dermis")
"""


def zips_module() -> Any:
    """The builder's own module that writes the index."""
    spec = importlib.util.spec_from_file_location("dermis_zips", ROOT / ".ci" / "zips.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def remade(path: Path, old: Path, change: Callable[[str], str]) -> Path:
    """Copy a zip, with another manifest."""
    with zipfile.ZipFile(old) as source, zipfile.ZipFile(path, "w") as target:
        for entry in source.infolist():
            content = source.read(entry)
            if entry.filename == "blender_manifest.toml":
                text = change(content.decode())
                assert text.encode() != content
                content = text.encode()
            target.writestr(entry, content)
    return path


def newer(text: str) -> str:
    """Return a manifest of a version to come."""
    return "\n".join(f'version = "{NEWER}"' if s.startswith("version = ") else s for s in text.split("\n"))


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[tuple[str, Callable[..., None]]]:
    """A served folder: its address, and what puts zips into it with the index beside them."""
    folder, module = tmp_path / "lab", zips_module()
    folder.mkdir()

    def serve(*paths: Path) -> None:
        for old in folder.iterdir():
            old.unlink()
        copies = [folder / path.name for path in paths]
        for path, copy in zip(paths, copies, strict=True):
            copy.hardlink_to(path)
        (folder / module.INDEX).write_text(module.index(copies), encoding="utf-8")

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/{module.INDEX}", serve
    server.shutdown()
    thread.join()
    server.server_close()


def test_an_update_is_offered_and_taken_while_enabled(
    fresh_blender: Any, zip_path: Path, tmp_path: Path, lab: tuple[str, Callable[..., None]]
) -> None:
    """The zip of another platform stands first in the listing, and is not the one that Blender takes."""
    url, serve = lab
    other = remade(
        tmp_path / "another.zip", zip_path, lambda text: text.replace(platform_of(text), '["windows-arm64"]')
    )
    first = remade(tmp_path / "newer.zip", zip_path, newer)
    serve(other, zip_path)
    fresh_blender(
        f"{ADD}walkthrough.done(bpy.ops.extensions.package_install(repo_index=index, pkg_id='dermis'))\n{INSTALLED}"
        "assert enabled == (True, True), enabled\nassert version != '99.0.0'\n"
        "answer = version\n",
        LAB=url,
    )
    serve(other, first)
    answer = fresh_blender(
        f"{ADD}import addon_utils\n"
        "assert addon_utils.enable('bl_ext.lab.dermis', default_set=True) is not None\n"
        "from importlib import import_module\n"
        "import_module('bl_ext.lab.dermis.core.kernels.library').kernels()\n"  # in use while the update comes
        "import bl_pkg\n"
        "remote = next(iter(bl_pkg.repo_cache_store_ensure().pkg_manifest_from_remote_ensure(\n"
        "    error_fn=print, directory_subset={repo.directory})))\n"
        "offered = remote['dermis'].version\n"
        "walkthrough.done(bpy.ops.extensions.package_upgrade_all(use_active_only=False))\n"
        f"{INSTALLED}"
        "answer = [offered, version, list(enabled), len(dir(bpy.ops.dermis)) > 0]\n",
        LAB=url,
    )
    assert answer == [NEWER, NEWER, [True, True], True]


def platform_of(text: str) -> str:
    """Return the list of platforms that a manifest states."""
    return next(s.partition(" = ")[2] for s in text.split("\n") if s.startswith("platforms = "))


REFUSED = """
import bpy, addon_utils, contextlib, io, walkthrough
walkthrough.install({ours!r})
before = (walkthrough.package_folder() / "blender_manifest.toml").read_text()
said = io.StringIO()
with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
    bpy.ops.extensions.package_install_files(filepath={wrong!r}, repo="user_default", enable_on_install=True)
same = (walkthrough.package_folder() / "blender_manifest.toml").read_text() == before
answer = [said.getvalue(), same, list(addon_utils.check(walkthrough.PACKAGE))]
"""


def test_a_zip_of_another_platform_or_blender_is_refused_and_the_installed_one_stays(
    fresh_blender: Any, zip_path: Path, tmp_path: Path
) -> None:
    """Blender's words are those in the names of the zips: the platform, and the version where the lines part."""
    target = next(word for word in ("linux-x64", "windows-x64", "macos-arm64") if word in zip_path.name)
    lines = ['blender_version_min = "4.5.0"\nblender_version_max = "5.1.0"', 'blender_version_min = "5.1.0"']
    ours, theirs = lines if "blender4.5" in zip_path.name else reversed(lines)
    for change, words in (
        (lambda text: text.replace(platform_of(text), '["plan9-x64"]'), [f"This platform ({target})", "(plan9-x64)"]),
        (lambda text: text.replace(ours, theirs), ["This Blender version (", "(5.1.0)"]),
    ):
        wrong = remade(tmp_path / "wrong.zip", zip_path, change)
        said, same, enabled = fresh_blender(REFUSED.format(ours=str(zip_path), wrong=str(wrong)))
        assert all(word in said for word in words), said
        assert same and enabled == [True, True]


def test_a_zip_of_another_python_is_not_enabled_and_blender_says_for_which_it_is(
    fresh_blender: Any, zip_path: Path, tmp_path: Path
) -> None:
    """Blender installs it, since it looks at no Python there, and refuses to enable it."""
    wrong = tmp_path / "wrong.zip"
    with zipfile.ZipFile(zip_path) as source, zipfile.ZipFile(wrong, "w") as target:
        text = source.read("blender_manifest.toml").decode()
        tag = next(word for word in ("cp311", "cp313", "cp314") if word in text)
        for entry in source.infolist():
            content, name = source.read(entry), entry.filename
            if name == "blender_manifest.toml":
                content = text.replace(f"-{tag}-{tag}-", "-cp39-cp39-").encode()
            elif name.startswith("wheels/"):
                name = name.replace(f"-{tag}-{tag}-", "-cp39-cp39-")
            target.writestr(name, content)
    said = fresh_blender(
        "import bpy, walkthrough\n"
        "try:\n"
        f"    bpy.ops.extensions.package_install_files(filepath={str(wrong)!r}, repo='user_default',"
        " enable_on_install=True)\n    answer = ''\n"
        "except RuntimeError as error:\n    answer = str(error)\n"
    )
    assert f"This Python version ({tag[2]}.{tag[3:]}) isn't compatible with (3.9)" in said, said


UPDATES = """
import bpy, locked_updates
answer = locked_updates.update({paths!r}, copies={copies})
"""
on_linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the stand-in for locked files reads /proc")


@on_linux
def test_updates_while_the_kernels_are_loaded_and_locked(fresh_blender: Any, zip_path: Path, tmp_path: Path) -> None:
    """As on Windows, where a loaded library cannot be removed; the newest is there after the next start, too."""
    paths = [str(locked_updates.of_version(tmp_path / f"{n}.zip", zip_path, f"90.0.{n}")) for n in range(3)]
    found = fresh_blender(UPDATES.format(paths=paths, copies=True))
    assert not found["failures"] and not found["refused"] and not found["stale"], found
    assert found["copies"] == [Path(found["path"]).name] and "site-packages" not in found["path"]
    after = fresh_blender(
        "import bpy, addon_utils, walkthrough\n"
        "assert addon_utils.enable(walkthrough.PACKAGE) is not None\n"
        "kernels = walkthrough.part('core.kernels.library').kernels()\n"
        "answer = [walkthrough.part('core.version').version(), str(kernels.path)]\n"
    )
    assert after == ["90.0.2", found["path"]]


@on_linux
def test_without_copies_an_update_fails_on_locked_kernels(fresh_blender: Any, zip_path: Path, tmp_path: Path) -> None:
    """The stand-in locks what is loaded: the test above is worth something."""
    paths = [str(locked_updates.of_version(tmp_path / f"{n}.zip", zip_path, f"90.0.{n}")) for n in range(2)]
    found = fresh_blender(UPDATES.format(paths=paths, copies=False))
    assert found["failures"] and found["refused"] and found["stale"], found
