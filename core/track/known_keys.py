"""What version 1 of the CSV header knows: keys, kinds of devices, kinds of limiting; everything else is refused."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from fractions import Fraction

from ..devices.kinds import KINDS
from ..errors import DermisError
from .command_track import LIMITED, CommandTrack

FIRST_META = ("generator", "finger", "scene", "frame_range", "fps", "content_hash")
# Information that methods write about themselves.
METHOD_META = (
    "method",
    "lead_s",
    "worst_kkt",
    "table_rows",
    "neighbours",
    "sensor",
    "stimuli",
    "relief",
    "relief_formula",
    "screen",
    "profile",
    "downhill",
    "scale",
    "law",
)
EXPORT_META = ("range", "forced")
OTHERS_META = "x."  # what other programs note: read, kept and written again, never understood
OWN_KEYS = ("device", "device_name", "kind", "spec_hash", "rate", "units", "samples")
OWN_GROUPS = ("channel", "parameter", "wire", "limited")
KEY = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")

_FPS = re.compile(r"[0-9]{1,12}(/[0-9]{1,12}|\.[0-9]{1,12})?")


def check_known(track: CommandTrack, where: str) -> None:
    """Refuse to write content that the readers refuse: see `check_kind`, `check_meta` and `check_limited`.

    Raises:
        DermisError: as said.
    """
    check_kind(track.spec.kind, where)
    for key, value in track.meta.items():
        check_meta(key, str(value), where)
    names = {c.name: None for c in track.channels}
    for key in track.limited:
        check_limited(key, names, where)


def check_kind(kind: str, where: str) -> None:
    """Refuse a kind of device that there is not.

    Raises:
        DermisError: as said.
    """
    if kind not in KINDS:
        raise DermisError("unknown kind of device", where=where, value=kind[:80], limit=", ".join(KINDS))


def check_meta(key: str, value: str, where: str) -> None:
    """Refuse what version 1 does not know of a track's origin, and frames that are none.

    Raises:
        DermisError: an unknown key that does not begin with 'x.', or a frame rate or range that cannot be read.
    """
    known = (*FIRST_META, *EXPORT_META, *METHOD_META)
    if key not in known and not (key.startswith(OTHERS_META) and key != OTHERS_META):
        raise DermisError(
            "unknown key",
            where=where,
            value=key,
            limit=", ".join(known),
            remedy=f"Begin the keys of other programs with '{OTHERS_META}'",
        )
    if key == "fps" and not _is_fps(value):
        raise DermisError("not a frame rate", where=where, value=value[:80], limit="such as 24/1 or 30000/1001")
    if key == "frame_range" and not _is_frame_range(value):
        raise DermisError("not a range of frames", where=where, value=value[:80], limit="FIRST LAST, such as 1 250")


def check_limited(key: str, names: Collection[str], where: str) -> None:
    """Refuse a count of limited samples of no channel, or of no kind that a limiter has.

    Args:
        key: 'CHANNEL.KIND'.
        names: names of the channels, as a set or the keys of a dict.

    Raises:
        DermisError: as said.
    """
    name, _, kind = key.rpartition(".")
    if kind not in LIMITED:
        raise DermisError("unknown kind of limiting", where=where, value=key[:80], limit=", ".join(LIMITED))
    if name not in names:
        limit = ", ".join(names)[:200]
        raise DermisError("a limited channel without a column", where=where, value=key[:80], limit=limit)


def is_own(key: str) -> bool:
    return key in OWN_KEYS or key.partition(".")[0] in OWN_GROUPS


def _is_fps(text: str) -> bool:
    try:
        return _FPS.fullmatch(text) is not None and Fraction(text) > 0
    except ZeroDivisionError:
        return False


def _is_frame_range(text: str) -> bool:
    try:
        first, last = (float(part) for part in text.split(" "))
    except ValueError:
        return False
    return math.isfinite(first) and math.isfinite(last) and first <= last
