"""Keys, kinds of devices and kinds of limiting in headers of tracks.

Everything that version 1 does not know is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from fractions import Fraction

from ..devices.kinds import KINDS
from ..errors import DermisError
from .command_track import LIMITED, CommandTrack

# Keys of `meta` that are first in a CSV file, in this order.
FIRST_META = ("generator", "finger", "scene", "frame_range", "fps", "content_hash")
# Keys for information that rendering methods write about themselves.
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
EXPORT_META = ("range", "forced")  # keys that an export adds
OTHERS_META = "x."  # beginning of the keys of other programs, which are kept and written again, but not used
OWN_KEYS = ("device", "device_name", "kind", "spec_hash", "rate", "units", "samples")  # keys that are not in `meta`
OWN_GROUPS = ("channel", "parameter", "wire", "limited")  # beginnings, before a dot, of more such keys
KEY = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")

_FPS = re.compile(r"[0-9]{1,12}(/[0-9]{1,12}|\.[0-9]{1,12})?")


def check_known(track: CommandTrack, where: str) -> None:
    """Raise an error for a track that readers would refuse.

    Raises:
        DermisError: see `check_kind`, `check_meta` and `check_limited`.
    """
    check_kind(track.spec.kind, where)
    for key, value in track.meta.items():
        check_meta(key, str(value), where)
    names = {c.name: None for c in track.channels}
    for key in track.limited:
        check_limited(key, names, where)


def check_kind(kind: str, where: str) -> None:
    """Raise an error for an unknown kind of device.

    Raises:
        DermisError: the kind is unknown.
    """
    if kind not in KINDS:
        raise DermisError("unknown kind of device", where=where, value=kind[:80], limit=", ".join(KINDS))


def check_meta(key: str, value: str, where: str) -> None:
    """Raise an error for an invalid entry of a track's `meta`.

    Raises:
        DermisError: the key is unknown and does not begin with 'x.', or a frame rate or frame range is invalid.
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
    """Raise an error for an invalid key of a track's `limited`.

    Args:
        key: 'CHANNEL.KIND'.
        names: names of the channels, a set or the keys of a dict.

    Raises:
        DermisError: the kind of limiting is unknown, or the track has no channel of this name.
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
