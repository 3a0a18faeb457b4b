"""What a chunk of samples may hold: scales that can be measured, animated parameters within their range."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..motion import singular
from ..parameters.material import BODY
from ..scene.tactile_scene import Chunk, TactileScene

LARGEST_SCALE = 1e9  # a millimetre becomes a thousand kilometres


def check_scales(kind: str, names: Sequence[str], poses: Array, frames: Array) -> None:
    """Refuse poses that stretch beyond all measure, and fingers of scale 0: objects of scale 0 are not there.

    Args:
        kind: 'finger', 'object' or 'screen'. names: of each. poses: finite, shape (k, n, 4, 4). frames: shape (n,).

    Raises:
        DermisError: with the first frame.
    """
    for name, linear in zip(names, poses[:, :, :3, :3], strict=True):
        most = np.abs(linear).max(axis=(1, 2))
        if (most > LARGEST_SCALE).any():
            k = int(np.argmax(most > LARGEST_SCALE))
            where = f"{kind} '{name}', frame {frames[k]:g}"
            raise DermisError("the scale is too large", where=where, value=most[k], limit=f"<= {LARGEST_SCALE:g}")
        if kind == "finger" and (flat := singular(linear)).any():
            raise DermisError(
                "a finger of scale 0 has no direction",
                where=f"finger '{name}', frame {frames[np.argmax(flat)]:g}",
                remedy="Give the finger a scale other than 0",
            )


def check_animated(scene: TactileScene, chunk: Chunk) -> None:
    """Refuse objects' animated parameters that are out of range; what is no number is mended by `Repairs`.

    Raises:
        DermisError: with the frame.
    """
    for b, body in enumerate(scene.bodies):
        for row in BODY.values():
            values = chunk.animated.get(f"body/{b}/{row.name}")
            if values is None or not row.numeric or len(values) != len(chunk.frames):
                continue  # `Repairs` refuses other lengths
            good = np.flatnonzero(np.isfinite(values))
            for k in good[[values[good].argmin(), values[good].argmax()]] if good.size else ():
                row.check(float(values[k]), f"object '{body.name}', frame {chunk.frames[k]:g}")
