"""The extension's zips: names, manifest, content, the index of a repository, the notes of a release.

`build_addon.py` brings the wheels and calls this. Any Python from 3.8 on will do.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
TEMPLATE = ROOT / "blender_addon" / "blender_manifest.toml"
INSTALL = ROOT / "blender_addon" / "INSTALL.md"
CHANGES = ROOT / "CHANGELOG.md"
LIBRARIES = (".so", ".dll", ".dylib")  # compiled code, which a zip has in a wheel
INDEX, SUMS, NOTES = "index.json", "SHA256SUMS", "RELEASE_NOTES.md"
MOST_BYTES = 100_000_000  # of one zip: uploads to Blender's own platform are reported to fail near 200 MB


class Refused(Exception):
    """A sentence for the person at the keyboard."""


class Line(NamedTuple):
    """The Blenders that one zip is for: as the zip's name says it, the first one, and the first one it is not for."""

    name: str
    first: str
    end: str | None


# By the Python that Blender's own builds run on: 3.11 up to 5.0, 3.13 from 5.1 on.
LINES = {"3.11": Line("blender4.5", "4.5.0", "5.1.0"), "3.13": Line("blender5.2", "5.1.0", None)}


def line(python: str) -> Line:
    """Return the Blenders that run on a Python; a distribution builds them on one that blender.org does not use."""
    return LINES.get(python) or Line(f"python{python}", "4.5.0", None)


def zip_name(target: str | None, python: str | None) -> str:
    """Return the name of a zip, such as 'dermis-0.2.0-blender4.5-windows-x64.zip'.

    Blender refuses a wrong zip in words of its own, which no extension can change: the platform, and the version where
    two lines part. The name has the same words.

    Args:
        target: the platform, as Blender names it. python: such as '3.11'. Both None: the zip without wheels.
    """
    words = ["dermis", manifest_value("version")]
    if target is not None and python is not None:
        words += [line(python).name, target]
    return "-".join(words) + ".zip"


def manifest(target: str | None, python: str | None, wheels: list[str]) -> str:
    """Return the manifest's template with the Blenders, the platform and the wheels of one zip filled in.

    Blender refuses a zip of another platform or Blender line before it touches the one that is installed.
    """
    text = TEMPLATE.read_text(encoding="utf-8")
    head, table, tail = text.partition("\n[permissions]")
    if not table:
        raise Refused(f"{TEMPLATE} has no [permissions] table.")
    if python is not None:
        of = line(python)
        lowest = f'blender_version_min = "{of.first}"'
        head, found = re.subn(r"^blender_version_min = .*$", lowest, head, flags=re.M)
        if found != 1:
            raise Refused(f"{TEMPLATE} does not state its blender_version_min once.")
        if of.end is not None:
            head = head.replace(lowest, f'{lowest}\nblender_version_max = "{of.end}"')
    if target is not None:
        head += f'\nplatforms = ["{target}"]\n'
    if wheels:
        head += "\nwheels = [\n" + "".join(f'  "./wheels/{name}",\n' for name in sorted(wheels)) + "]\n"
    return head + table + tail


def manifest_value(key: str) -> str:
    """Return a string of the manifest's template."""
    found = re.search(rf'^{key} = "([^"]+)"', TEMPLATE.read_text(encoding="utf-8"), re.M)
    if not found:
        raise Refused(f"{TEMPLATE} does not state its {key}.")
    return found.group(1)


def sources() -> dict[str, Path]:
    """Return the files of the package by their name in the zip: the add-on, with the engine and the presets inside."""
    files = {"LICENSE": ROOT / "LICENSE"}
    for folder, prefix in ((ROOT / "blender_addon", ""), (ROOT / "core", "core/"), (ROOT / "presets", "presets/")):
        for path in folder.rglob("*"):
            parts = path.relative_to(folder).parts
            hidden = any(part.startswith(".") or part == "__pycache__" for part in parts)
            if (
                path.is_file()
                and not hidden
                and path.suffix not in (".pyc", ".blend1", *LIBRARIES)
                and path != TEMPLATE
            ):
                files[prefix + "/".join(parts)] = path
    return files


def write_zip(path: Path, target: str | None, python: str | None, wheels: dict[str, Path]) -> None:
    """Write the zip of the extension."""
    entries: dict[str, Any] = dict(sources())
    entries["blender_manifest.toml"] = manifest(target, python, list(wheels)).encode()
    entries.update({f"wheels/{name}": wheel for name, wheel in wheels.items()})
    write_archive(path, entries)
    if path.stat().st_size > MOST_BYTES:
        size = path.stat().st_size / 1e6
        raise Refused(f"{path} has {size:.1f} MB, and {MOST_BYTES / 1e6:.0f} are allowed: look at its largest files.")


def write_archive(path: Path, entries: dict[str, Any]) -> None:
    """Write a zip that is the same bytes every time, of bytes or files: sorted, dated 1980, stored.

    Stored, because wheels are compressed already and the bytes of a compressor differ between zlib's versions.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    with zipfile.ZipFile(part, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(entries):
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.create_system, entry.external_attr = 3, 0o100644 << 16
            content = entries[name]
            archive.writestr(entry, content if isinstance(content, bytes) else content.read_bytes())
    os.replace(part, path)


def write_kernels_wheel(wheel: Path, library: Path, version: str, tag: str) -> None:
    """Write the wheel that brings a platform's compiled library to Blender, for every Python.

    The extension's own folder is no place for it: Blender's rules take compiled code in wheels alone.
    """
    about = f"dermis_kernels-{version}.dist-info"
    summary = "Summary: The compiled part of Dermis\nLicense-Expression: GPL-3.0-or-later\n"
    entries: dict[str, bytes] = {
        "dermis_kernels/__init__.py": b'"""The compiled part of Dermis, which loads it by its file name."""\n',
        f"dermis_kernels/{library.name}": library.read_bytes(),
        f"{about}/METADATA": f"Metadata-Version: 2.4\nName: dermis-kernels\nVersion: {version}\n{summary}".encode(),
        f"{about}/WHEEL": f"Wheel-Version: 1.0\nGenerator: dermis\nRoot-Is-Purelib: false\nTag: {tag}\n".encode(),
        f"{about}/licenses/LICENSE": (ROOT / "LICENSE").read_bytes(),
    }
    rows = []
    for name, content in entries.items():
        sha = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        rows.append(f"{name},sha256={sha},{len(content)}\n")
    entries[f"{about}/RECORD"] = "".join([*rows, f"{about}/RECORD,,\n"]).encode()
    write_archive(wheel, entries)


# -- what lies beside the zips -----------------------------------------------------------------------------------------


def released(folder: Path) -> list[Path]:
    """Return the zips of the manifest's version in a folder, sorted by name; the zip without wheels is not one."""
    return sorted(folder.glob(f"dermis-{manifest_value('version')}-*.zip"))


def index(zips: list[Path]) -> str:
    """Return the listing that Blender reads of a remote repository, as `blender --command extension server-generate`
    writes it; equal zips give equal text.
    """
    rows = []
    for path in zips:
        with zipfile.ZipFile(path) as archive:
            row, wheels = _fields(archive.read("blender_manifest.toml").decode("utf-8"))
        row["python_versions"] = sorted({f"3.{minor}" for minor in re.findall(r"-cp3(\d+)-cp", wheels)})
        row.update(
            archive_url=f"./{path.name}", archive_size=path.stat().st_size, archive_hash=f"sha256:{digest(path)}"
        )
        rows.append(row)
    return json.dumps({"version": "v1", "blocklist": [], "data": rows}, indent=2) + "\n"


def _fields(text: str) -> tuple[dict[str, Any], str]:
    """Return what a manifest of `manifest` says, and the lines of its wheels. Its values are those of JSON too."""
    head, wheels, rest = re.split(r"^wheels = \[\n(.*?)^\]$", text, flags=re.M | re.S)
    fields: dict[str, Any] = {}
    table = fields
    for words in (head + rest).splitlines():
        if words.startswith("["):
            table = fields[words.strip("[]")] = {}
        elif words and not words.startswith("#"):
            key, _, value = words.partition(" = ")
            table[key] = json.loads(value)
    return fields, wheels


def sums(zips: list[Path]) -> str:
    """Return the checksums, as `sha256sum --check` reads them."""
    return "".join(f"{digest(path)}  {path.name}\n" for path in zips)


def release_notes(zips: list[Path]) -> str:
    """Return the notes of a release for the page it is offered on: what is new, the files, and how to install one.

    What is new is the changelog's part of the manifest's version, or what has come since, where there is any.
    """
    parts = re.split(r"^## +", CHANGES.read_text(encoding="utf-8"), flags=re.M)[1:]
    version = manifest_value("version")
    titled = [part for part in parts if re.match(rf"Unreleased\n|{re.escape(version)}\b", part)]
    news = [part.partition("\n")[2].strip() for part in titled]
    if not any(news):
        raise Refused(f"{CHANGES} has no part for {version}: its heading is '## {version}, DATE', or '## Unreleased'.")
    rows = [f"| `{z.name}` | {z.stat().st_size / 1e6:.1f} MB | `{digest(z)}` |" for z in zips]
    steps = INSTALL.read_text(encoding="utf-8").partition("\n")[2].replace("\n## ", "\n### ").strip()
    head = f"# Dermis {version}\n\n## What is new\n\n{next(part for part in news if part)}\n\n"
    files = "\n".join(["## Files", "", "| file | size | SHA-256 |", "|---|---|---|", *rows])
    return f"{head}{files}\n\n## Install\n\n{steps}\n"


def digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
