"""Images of heights, read without Blender: PNG, TIFF, netpbm, PFM and NPY."""

from __future__ import annotations

import os
import re
from pathlib import Path

from ..errors import DermisError, Finding
from ..files import read_bytes
from ..foreign import damage_told
from . import netpbm, npy, png_tiff
from .raster import Raster, grey_of

__all__ = ["Raster", "gap_after", "grey_of", "read", "sequence"]

READABLE = "PNG, TIFF, PGM, PPM, PFM and NPY"
_NETPBM = (b"P2", b"P3", b"P5", b"P6", b"Pf", b"PF")
_OTHERS = {
    b"\xff\xd8\xff": "JPEG",
    b"\x76\x2f\x31\x01": "OpenEXR",
    b"RIFF": "WebP",
    b"GIF8": "GIF",
    b"BM": "BMP",
    b"P1": "PBM",
    b"P4": "PBM",
    b"#?RA": "Radiance HDR",
}


def read(path: str | Path) -> Raster:
    """Read one image; its first bytes determine the format, not its suffix.

    Raises:
        DermisError: the file is missing, empty or damaged, has no pixels, or has a format that is not read here.
    """
    path = Path(path)
    where = f"image '{path.name}'"
    data = read_bytes(path, where=where)
    if not data:
        raise DermisError("the image file is empty", where=where)
    if data.startswith((png_tiff.PNG, *png_tiff.TIFF)):
        return png_tiff.decode(data, where)
    if data.startswith(npy.MAGIC):
        return npy.decode(data, where)
    if data[:2] in _NETPBM:
        return netpbm.decode(data, where)
    kind = next((name for magic, name in _OTHERS.items() if data.startswith(magic)), "unknown")
    raise DermisError(
        "this kind of image is not supported",
        where=where,
        value=kind,
        limit=READABLE,
        remedy="Save it as a 16-bit PNG, or open it in Blender and choose it there",
    )


def sequence(path: str | Path) -> tuple[Path, ...]:
    """Return the numbered files of an image sequence from `path` on, in order.

    The number is the digits at the end of the file's name. Without such digits, only `path` itself is returned. The
    sequence ends before the first missing number, see `gap_after`.

    Raises:
        DermisError: the file does not exist, or its folder cannot be read.
    """
    path = Path(path)
    first, found = _numbered(path)
    last = first
    while last + 1 in found:
        last += 1
    return tuple(found[i] for i in range(first, last + 1))


def gap_after(path: str | Path) -> Finding | None:
    """Return a finding if the sequence from `path` on has files after a gap.

    Raises:
        DermisError: the file does not exist, or its folder cannot be read.
    """
    path = Path(path)
    first, found = _numbered(path)
    run = sequence(path)
    beyond = sorted(number for number in found if number >= first + len(run))
    if not beyond:
        return None
    return Finding(
        "warning",
        "sequence-gap",
        "numbers are missing in the image sequence; the files after the gap are left out",
        where=f"image sequence '{path.name}'",
        value=f"{run[-1].name}, then {found[beyond[0]].name}",
        remedy="Number the files without a gap",
        count=len(beyond),
    )


def _numbered(path: Path) -> tuple[int, dict[int, Path]]:
    """Return a file's number, and all files that differ only in the number.

    Raises:
        DermisError: the file does not exist, or its folder cannot be read.
    """
    if not os.path.isfile(path):
        raise DermisError("no such image", where=f"image '{path.name}'", value=str(path))
    match = re.fullmatch(r"(.*?)(\d+)", path.stem)
    if not match:
        return 0, {0: path}
    prefix, digits = match.group(1), match.group(2)
    pattern = re.compile(re.escape(prefix) + r"(\d+)" + re.escape(path.suffix))
    # If the number of `path` is padded with zeros, the other numbers must have as many digits.
    padded = digits.startswith("0")
    found = {int(digits): path}
    with damage_told("the folder of the image sequence cannot be read", f"image '{path.name}'"):
        others = sorted(path.parent.iterdir())
    for other in others:
        number = pattern.fullmatch(other.name)
        if number and (len(number.group(1)) == len(digits) or not padded):
            found.setdefault(int(number.group(1)), other)
    return int(digits), found
