"""Updates of the extension while its kernels are loaded, with a stand-in for Windows, which locks loaded files.

`lock()` replaces calls of the standard library: files whose path `/proc/self/maps` lists can be renamed, as on Windows,
but neither removed nor overwritten. It says nothing of what another process would meet. On Windows itself nothing is
replaced: the system locks.

`python locked_updates.py ZIP FOLDER N` makes N newer zips. `blender --background --python locked_updates.py -- FOLDER`
installs them one after another.
"""

from __future__ import annotations

import builtins
import contextlib
import io
import os
import re
import sys
import zipfile
from pathlib import Path
from typing import Any


def loaded(suffix: str = ".so") -> set[str]:
    """Return the libraries that this process has loaded from a folder of extensions."""
    lines = Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()
    paths = {line.split(maxsplit=5)[5] for line in lines if len(line.split(maxsplit=5)) == 6}
    return {path for path in paths if path.endswith(suffix) and "extensions" in path}


def lock() -> list[str]:
    """Lock loaded libraries from now on; return the list to which what was refused is added."""
    refused: list[str] = []
    if not sys.platform.startswith("linux"):
        return refused
    unlink, opened = os.unlink, builtins.open

    def check(path: Any, folder: int | None = None) -> None:
        where = os.readlink(f"/proc/self/fd/{folder}") if folder is not None else os.getcwd()
        real = os.path.realpath(os.path.join(where, os.fspath(path)))
        if real in loaded():
            refused.append(real)
            raise PermissionError(13, "The process cannot access the file: it is being used by another process", real)

    def locked_unlink(path: Any, *, dir_fd: int | None = None) -> None:
        check(path, dir_fd)
        unlink(path, dir_fd=dir_fd)

    def locked_open(file: Any, mode: str = "r", *more: Any, **named: Any) -> Any:
        if isinstance(file, str | os.PathLike) and set(mode) & set("wax+"):
            check(file)
        return opened(file, mode, *more, **named)

    os.unlink = os.remove = locked_unlink  # type: ignore[assignment]
    builtins.open = io.open = locked_open  # type: ignore[assignment]
    for calls in (os.supports_dir_fd, os.supports_follow_symlinks):
        if unlink in calls:
            calls.add(locked_unlink)  # type: ignore[attr-defined]
    return refused


def of_version(path: Path, old: Path, version: str) -> Path:
    """Copy a zip as one of another version, which brings kernels of that version and no other wheel, so it is small."""
    with zipfile.ZipFile(old) as source, zipfile.ZipFile(path, "w") as target:
        (name,) = (n for n in source.namelist() if n.startswith("wheels/dermis_kernels-"))
        was, now = name.split("-")[1], f"{version}.1"
        wheel = name.replace(was, now)
        for entry in source.namelist():
            content = source.read(entry)
            if entry == "blender_manifest.toml":
                text = re.sub(r"^version = .*$", f'version = "{version}"', content.decode(), flags=re.M)
                content = re.sub(r"^wheels = .*?^\]", f'wheels = ["./{wheel}"]', text, flags=re.M | re.S).encode()
            if not entry.startswith(("wheels/", "presets/pictures/")):
                target.writestr(entry, content)
        inner = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(source.read(name))) as before, zipfile.ZipFile(inner, "w") as after:
            for entry in before.namelist():
                content = before.read(entry)
                if ".dist-info/" in entry:
                    content = content.replace(was.encode(), now.encode())
                after.writestr(entry.replace(was, now), content)
        target.writestr(wheel, inner.getvalue())
    return path


def update(zips: list[str], *, copies: bool = True) -> dict[str, Any]:
    """Install zips one after another in this Blender, the kernels of each loaded and locked when the next one comes.

    Args:
        copies: as the product does; otherwise kernels are loaded from where Blender has installed them.

    Returns:
        'failures': a sentence each. 'refused': what could not be removed. 'stale': what Blender has put off until its
        next start. 'path': of the library that was loaded last. 'copies': names in the folder of copies.
    """
    import bpy
    import walkthrough

    extensions = Path(bpy.utils.user_resource("EXTENSIONS"))
    refused, failures, said, path = lock(), [], io.StringIO(), ""
    for number, name in enumerate(zips):
        try:
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                walkthrough.install(Path(name))
            library = walkthrough.part("core.kernels.library")
            if not copies:
                library._folder_of_copies = lambda: None
            path = str(library.kernels().path)
        except Exception as error:
            failures.append(f"update {number}: {error}")
            continue
        version = walkthrough.part("core.version").version()
        brought = [p.parent.name for p in (extensions / ".local").rglob("dermis_kernels-*.dist-info/RECORD")]
        if brought != [f"dermis_kernels-{version}.1.dist-info"]:
            failures.append(f"update {number} to {version}: the kernels are {brought}; {said.getvalue()[-500:]}")
    folder = Path(bpy.utils.extension_path_user(walkthrough.PACKAGE)) / "kernels"
    return {
        "failures": failures,
        "refused": refused,
        "stale": [str(p) for p in extensions.rglob(".~stale~")],
        "path": path,
        "copies": [p.name for p in folder.iterdir()] if folder.is_dir() else [],
    }


def main(arguments: list[str]) -> int:
    """Make newer zips, or install those of a folder; return 1 where an update failed."""
    if len(arguments) == 3:
        old, folder, count = Path(arguments[0]), Path(arguments[1]), int(arguments[2])
        folder.mkdir(parents=True, exist_ok=True)
        for number in range(count):
            print(of_version(folder / f"{number:03}.zip", old, f"90.0.{number}"))
        return 0
    sys.path.insert(0, str(Path(__file__).resolve().parent))
    zips = sorted(Path(arguments[0]).resolve().glob("*.zip"))
    found = update([str(path) for path in zips])
    print(f"{len(zips)} updates, failed: {found['failures']}; put off: {found['stale']}", flush=True)
    return int(not zips or bool(found["failures"] or found["stale"]))


if __name__ == "__main__":
    done = 1
    try:
        done = main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
    except Exception:
        sys.excepthook(*sys.exc_info())
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(done)  # Blender 4.5 hangs where the interpreter ends with an add-on still registered
