"""Checks of a chunk of samples: scales of poses, and ranges of animated parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..motion import singular
from ..parameters.device import DEVICE
from ..parameters.finger import FINGER
from ..parameters.material import BODY
from ..parameters.parameter import Table
from ..parameters.screen import SCREEN
from ..scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Screen, TactileScene

if TYPE_CHECKING:
    from .pad_contact import PadContact

LARGEST_SCALE = 1e9  # largest component of a linear map


def check_scales(kind: str, names: Sequence[str], poses: Array, frames: Array) -> None:
    """Raise an error for poses above `LARGEST_SCALE`, and for fingers of scale 0.

    Objects of scale 0 are valid; they count as absent.

    Args:
        kind: 'finger', 'object' or 'screen'.
        names: names of the items.
        poses: poses of the items, finite, shape (k, n, 4, 4).
        frames: scene frame of each sample, shape (n,).

    Raises:
        DermisError: a scale is invalid. The error names the first frame.
    """
    linear = poses[:, :, :3, :3]
    if np.abs(linear).max(initial=0.0) > LARGEST_SCALE:
        i = int((np.abs(linear) > LARGEST_SCALE).any(axis=(1, 2, 3)).argmax())
        most = np.abs(linear[i]).max(axis=(1, 2))
        k = int(np.argmax(most > LARGEST_SCALE))
        where = f"{kind} '{names[i]}', frame {frames[k]:g}"
        raise DermisError("the scale is too large", where=where, value=most[k], limit=f"<= {LARGEST_SCALE:g}")
    if kind == "finger" and (flat := singular(linear.reshape(-1, 3, 3)).reshape(linear.shape[:2])).any():
        i = int(flat.any(axis=1).argmax())
        raise DermisError(
            "a finger of scale 0 has no direction",
            where=f"finger '{names[i]}', frame {frames[np.argmax(flat[i])]:g}",
            remedy="Give the finger a scale other than 0",
        )


def check_animated(scene: TactileScene, chunk: Chunk) -> None:
    """Raise an error for animated parameters of fingers, objects and screens that are out of range.

    Values that are not finite are replaced by `Repairs`. Parameters of devices are checked by `check_device`.

    Raises:
        DermisError: a value is out of range. The error names the frame.
    """
    if not chunk.animated:
        return
    groups: tuple[tuple[str, str, Sequence[Finger | Body | Screen], Table], ...] = (
        ("finger", "finger", scene.fingers, FINGER),
        ("body", "object", scene.bodies, BODY),
        ("screen", "screen", scene.screens, SCREEN),
    )
    owners = {key.rpartition("/")[0] for key in chunk.animated}
    for owner, kind, items, table in groups:
        for i, item in enumerate(items):
            if f"{owner}/{i}" in owners:
                _check_series(chunk.animated, f"{owner}/{i}", table, chunk.frames, f"{kind} '{item.name}'")


def check_device(pad_contact: PadContact, finger: Finger, index: int, use: DeviceUse) -> None:
    """Raise an error for animated parameters of a finger's device that are out of range.

    Args:
        pad_contact: contact of the pads over the whole range.
        finger: header of the finger.
        index: index of the finger in the scene.
        use: the device on the finger.

    Raises:
        DermisError: a value is out of range. The error names the frame.
    """
    place = next(i for i, device in enumerate(finger.devices) if device is use)
    _check_series(pad_contact.animated, f"device/{index}/{place}", DEVICE, pad_contact.frames, use.preset)


def _check_series(animated: Mapping[str, Array], owner: str, table: Table, frames: Array, where: str) -> None:
    own = {key.removeprefix(f"{owner}/"): values for key, values in animated.items() if key.startswith(f"{owner}/")}
    for row in table.values() if own else ():
        values = own.get(row.name)
        if values is None or not row.numeric or len(values) != len(frames):
            continue  # `Repairs` raises an error for other lengths
        good = np.flatnonzero(np.isfinite(values))
        for k in good[[values[good].argmin(), values[good].argmax()]] if good.size else ():
            row.check(float(values[k]), f"{where}, frame {frames[k]:g}")
