"""Agreement to the files that the settings of a .blend name.

Nothing reads or writes such a file before a person of this session has agreed. To set a path in this session, in the
panel or by a script, is to agree. Paths that came with the file have to be confirmed; the session remembers this.
"""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import bpy

from .._core import DermisError, core
from . import stream_log


class Claim(NamedTuple):
    """A file that a setting names.

    `kind` is 'read', 'write' or 'send', and `what` is its purpose. A claim to send has an address instead of a path.
    """

    path: str
    kind: str
    what: str


_WHAT = {
    "url": ("write", "a record of every byte (spy://)"),
    "track_file": ("read", "the command track to be played"),
    "screen_file": ("read", "the screen map"),
    "log_folder": ("write", "a log of the stream, in this folder"),
    "tee": ("send", "the rows of the stream, to this address"),
}
_confirmed: set[tuple[str, str]] = set()  # (path, kind)


def claims(settings: Any, *names: str) -> list[Claim]:
    """Return every file that settings name, whichever mode is chosen.

    Args:
        names: the settings that are read; all if left out.
    """
    return [Claim(path, *_WHAT[name]) for name in names or _WHAT for path in _paths(settings, name)]


def _paths(settings: Any, name: str) -> list[str]:
    if name == "tee":
        return list(settings.tee.split())
    if name == "log_folder":
        path = str(stream_log.folder(settings)) if settings.use_log else ""
    else:
        text = getattr(settings, name)
        path = _record_of(text) if name == "url" else bpy.path.abspath(text)
    return [os.path.realpath(path)] if path else []


def confirm_log(settings: Any) -> None:
    """Remember that a person chose the folder for logs, switched on or not."""
    _confirmed.add((os.path.realpath(stream_log.folder(settings)), _WHAT["log_folder"][0]))


def pending(settings: Any, *names: str) -> list[Claim]:
    """Return the files that were not confirmed."""
    return [claim for claim in claims(settings, *names) if (claim.path, claim.kind) not in _confirmed]


def confirm(agreed: list[Claim]) -> None:
    """Remember for this session that a person agreed to files."""
    _confirmed.update((claim.path, claim.kind) for claim in agreed)


def check(settings: Any, *names: str) -> None:
    """Refuse to go on with files that were not confirmed.

    Raises:
        DermisError: there are such files; the message has the kind and the path of each.
    """
    if asked := pending(settings, *names):
        raise DermisError(
            "this .blend names files that were not confirmed",
            where="streaming",
            value="; ".join(f"{claim.kind} {claim.path}" for claim in asked),
            remedy="Press Connect and look at the paths, or choose files of your own",
        )


def forget() -> None:
    """Forget all agreements."""
    _confirmed.clear()


def _record_of(url: str) -> str:
    from tempfile import gettempdir

    try:
        address = core.stream.links.url.Url(url)
    except DermisError:
        return ""  # not an address: connecting reports this, and opens nothing
    path = address.options.get("file", "") if address.scheme == "spy" else ""
    return os.path.join(gettempdir(), path) if path else ""  # the folder in which the sender works
