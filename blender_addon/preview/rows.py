"""Rows of a preview: the values of each device at one frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from .._core import Array, core

NO_PATH = np.empty((0, 2))
STEP_SECONDS = 0.25
# Channels without which a device of some kind is drawn as its values alone.
NEEDED = {
    "tactor": {"tactor_x", "tactor_y"},
    "screen": {"amplitude"},
    "coil": {"displacement", "voltage"},
    "thimble": {"servo_1"},
}
FULL_SCALE = {"m": 2e-3, "N": 0.4}  # by unit, where a preset states no limit. Source: [S3] and [S1], their devices


def goes_on(gap: float) -> bool:
    """Return whether a step of `gap` seconds continues the frame before.

    Playback may skip frames; a longer step is a jump.
    """
    return 1e-9 < gap <= STEP_SECONDS


def origin(first: float, since: float | None, *, begins: bool) -> str:
    """Return the view's words on where a live frame comes from.

    Args:
        first: frame at which everything was at rest.
        since: frame of the kept state from which this frame was reached; None without one.
        begins: whether this is the frame at rest itself.
    """
    if since is not None:
        return f"live: continued from frame {since:g}"
    return (
        f"live: frame {first:g} alone, without earlier contact" if begins else f"live: computed from frame {first:g} on"
    )


def as_it_was(note: str) -> str:
    """Return the view's words on a live frame that is shown once more."""
    return note.replace("live: ", "live, as played: ", 1)


@dataclass(frozen=True)
class Row:
    """One device on one finger, now.

    Attributes:
        finger, device: the finger object's name and the preset's key.
        title, kind: the device's name for people, and its kind.
        values, low, high, units: by channel name, in SI; limits are None where there are none.
        path: over the last moments, oldest first, shape (n, 2): a tactor's positions [m], a voice coil's times [s] and
            voltages [V]; empty for others.
        contact: 1 while the finger touches, 0 while not, None where unknown.
        signals: diagnostic values by name, such as 'mismatch'.
        note: in words, why there are no values.
    """

    finger: str
    device: str
    title: str
    kind: str
    values: Mapping[str, float]
    low: Mapping[str, float | None]
    high: Mapping[str, float | None]
    units: Mapping[str, str]
    path: Array
    contact: float | None
    signals: Mapping[str, float] = field(default_factory=dict)
    note: str = ""

    @property
    def numbers(self) -> Array:
        """All values in the order of the channels [SI]."""
        return np.array(list(self.values.values()))

    @property
    def drawn(self) -> core.devices.kinds.Drawn:
        """Return the style of drawing of the device's kind, '' if it lacks channels."""
        kind = core.devices.kinds.KINDS.get(self.kind)
        return kind.drawn if kind is not None and NEEDED.get(kind.drawn, set()) <= set(self.values) else ""

    def full_scale(self, name: str) -> float:
        """Return the value of a channel that fills its drawing [SI]."""
        return self.high.get(name) or FULL_SCALE.get(self.units[name], 1.0)


@dataclass(frozen=True)
class Preview:
    """All devices at one frame.

    Attributes:
        source: 'device', 'file', 'bake', 'stale', 'earlier' or 'live'. note: a remark on it for the reader.
    """

    frame: float
    source: str
    note: str
    rows: tuple[Row, ...]


def row_of(
    finger: str,
    device: str,
    spec: core.devices.spec.DeviceSpec,
    values: Mapping[str, float],
    contact: float | None,
    *,
    path: Array = NO_PATH,
    signals: Mapping[str, float] | None = None,
    note: str = "",
) -> Row:
    """Return the row of a device.

    Args:
        finger, device: name of the finger's object, key of the preset. spec: the preset.
        values: values of channels, by name [SI]; the row leaves out channels without one.
        contact, path, signals, note: see `Row`.
    """
    return Row(
        finger=finger,
        device=device,
        title=spec.name,
        kind=spec.kind,
        values={c.name: values[c.name] for c in spec.channels if c.name in values},
        low={c.name: c.low for c in spec.channels},
        high={c.name: c.high for c in spec.channels},
        units={c.name: c.unit for c in spec.channels},
        path=path,
        contact=contact,
        signals=signals or {},
        note=note,
    )


def by_channel(spec: core.devices.spec.DeviceSpec, values: Array) -> dict[str, float]:
    """Return values in the order of a device's channels by their names."""
    return dict(zip((c.name for c in spec.channels), values.tolist(), strict=True))
