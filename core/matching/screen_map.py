"""ScreenMap: height maps of a friction screen, with the profile and the law that give its commands.

Bakes and followers of a real finger use the same map, so that they give the same commands.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..devices.friction_screen import FrictionScreen
from ..effects.gradient import bilinear, check_map, gradient, metres_of, steepest
from ..effects.heading import REST_RADIUS, Heading
from ..effects.slide import MAX_FRICTION, MIN_FRICTION, friction_of_slope, without_downhill
from ..errors import DermisError
from ..files import write_bytes
from ..foreign import json_of
from ..npz import opened_npz
from ..parameters.device import DEVICE

SCHEMA = "dermis-screen-map 1"


@dataclass(frozen=True)
class Relief:
    """Properties of the screen at positions of a finger, shape (n,) each; zero off the screen.

    Attributes:
        friction: friction from 0 to 100, before the law.
        grad_x, grad_y: slopes [m/m].
        height: height above the lowest point [m].
    """

    friction: Array
    grad_x: Array
    grad_y: Array
    height: Array


@dataclass(frozen=True)
class Answer:
    """Command of the screen for one touch.

    Attributes:
        amplitude: amplitude, at most the device's limit [V].
        carrier: carrier frequency [Hz].
        friction: friction before the limit.
        limited: whether the amplitude was limited.
    """

    amplitude: float
    carrier: float
    friction: float
    limited: bool


@dataclass(frozen=True, eq=False)
class ScreenMap:
    """Height maps with all settings that determine the voltage for a touch.

    Attributes:
        heights: height maps, row 0 at the bottom, float32, shape (k, rows, columns).
        size: width and height of the screen [m].
        height_unit: length of one unit of height [m]; 0 for the screen's width.
        device: law and limits of the screen.
        profile: 'slope', 'height' or 'rectangle'.
        downhill: see `without_downhill`, for the profile 'slope'.
        scale: f0, friction for a slope of 1, or for a height of 1 m; not used by 'rectangle'.
        offset: friction of the lowest point, for 'height'.
        threshold: fraction of the range of heights above which 'rectangle' is on.
        lowest, highest: range of heights over the whole bake [units of the map].
        maps_per_second: rate of a sequence of maps [1/s].
        start: time at which the first map is shown [s]. Maps are interpolated in time.
        direction_window: length of the moving average of the direction of a real finger [s].

    Raises:
        DermisError: a map or a setting is invalid.
    """

    heights: Floats32
    size: tuple[float, float]
    height_unit: float
    device: FrictionScreen
    profile: str = "slope"
    downhill: str = "rectify"
    scale: float = 0.0
    offset: float = 0.0
    threshold: float = 0.5
    lowest: float = 0.0
    highest: float = 0.0
    maps_per_second: float = 0.0
    start: float = 0.0
    direction_window: float = 0.0
    _slopes: dict[int, Floats32] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.heights.ndim != 3:
            raise DermisError("the maps are not (count, rows, columns)", where="screen map", value=self.heights.shape)
        check_map(self.heights, self.size, self.height_unit, "screen map")
        for name in ("profile", "downhill"):
            DEVICE[name].check(getattr(self, name), "screen map")
        for name in ("scale", "offset", "threshold", "lowest", "highest", "start"):
            if not math.isfinite(getattr(self, name)):
                raise DermisError(f"'{name}' is not a finite number", where="screen map", value=getattr(self, name))
        for name in ("maps_per_second", "direction_window"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise DermisError(f"'{name}' must be zero or more", where="screen map", value=getattr(self, name))

    @property
    def metres(self) -> float:
        """Length of one unit of the map [m]."""
        return metres_of(self.size, self.height_unit)

    @property
    def changing(self) -> bool:
        """Whether the heights change with time."""
        return len(self.heights) > 1 and self.maps_per_second > 0

    def heading(self) -> Heading:
        """Return a filter for the direction of a real finger, whose reported positions have jitter."""
        return Heading(self.direction_window, REST_RADIUS)

    def on_screen(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Return whether points [m] are on the screen, including its border."""
        return (np.abs(x) <= 0.5 * self.size[0]) & (np.abs(y) <= 0.5 * self.size[1])

    def relief(
        self,
        x: Array,
        y: Array,
        direction: Array,
        times: Array | None = None,
        *,
        scale: float | Array | None = None,
        threshold: float | Array | None = None,
    ) -> Relief:
        """Return the properties that a finger feels at points of the screen.

        Args:
            x, y: positions from the screen's centre [m], finite, shape (n,).
            direction: unit vectors of the motion, or zero before the first movement, shape (n, 2).
            times: times for a sequence of maps [s], shape (n,).
            scale, threshold: animated values that replace the map's own, shape (n,).

        Source: [S4] eq. 5 and Table 1
        """
        height, grad_x, grad_y = self._read(x, y, times)
        height = (height - self.lowest) * self.metres
        f0 = self.scale if scale is None else scale
        if self.profile == "slope":
            friction = without_downhill(friction_of_slope(grad_x, grad_y, direction, f0), self.downhill)
        elif self.profile == "height":
            friction = self.offset + f0 * height
        else:
            level = (self.threshold if threshold is None else threshold) * (self.highest - self.lowest) * self.metres
            friction = np.where((height >= level) & (self.highest > self.lowest), MAX_FRICTION, MIN_FRICTION)
        inside, felt = self.on_screen(x, y), (friction, grad_x, grad_y, height)
        return Relief(*felt) if inside.all() else Relief(*(np.where(inside, values, 0.0) for values in felt))

    def answer(self, x: float, y: float, direction: tuple[float, float], time: float = 0.0) -> Answer:
        """Return the command for one touch, within the device's limits.

        Args:
            x, y: position from the screen's centre [m].
            direction: direction of the motion, of any length; (0, 0) before the first.
            time: time for a sequence of maps [s].

        Raises:
            DermisError: a number is not finite.
        """
        numbers = (x, y, *direction, time)
        if not all(math.isfinite(n) for n in numbers):
            raise DermisError("the touch is not finite", where="screen map", value=numbers)
        length = math.hypot(*direction) or 1.0
        unit = np.array([[direction[0] / length, direction[1] / length]])
        friction = float(self.relief(np.array([x]), np.array([y]), unit, np.array([time])).friction[0])
        volts = float(self.device.law.volts(friction))
        return Answer(min(volts, self.device.limit), self.device.carrier, friction, volts > self.device.limit)

    def _read(self, x: Array, y: Array, times: Array | None) -> Array:
        """Interpolate heights and both slopes at points and times, shape (3, n)."""
        count = len(self.heights)
        if count == 1:
            return bilinear((self.heights[0], *self._slopes_of(0)), self.size, x, y).astype(np.float64) + 0.0
        at = np.zeros(len(x)) if times is None else (times - self.start) * self.maps_per_second
        at = np.clip(at, 0.0, count - 1)
        first = np.floor(at)
        later = at - first
        out = np.zeros((3, len(x)))
        for index in range(int(first.min(initial=0)), int(np.ceil(at.max(initial=0))) + 1):
            weight = np.where(first == index, 1.0 - later, np.where(first == index - 1, later, 0.0))
            used = weight > 0
            if not used.any():
                continue
            planes = (self.heights[index], *self._slopes_of(index))
            out[:, used] += weight[used] * bilinear(planes, self.size, x[used], y[used])
        return out

    def _slopes_of(self, index: int) -> Floats32:
        """Return one map's slopes; the last two maps' are kept, as interpolation in time requires."""
        if index not in self._slopes:
            rows, columns = self.heights.shape[1:]
            spacing = (self.size[0] / columns, self.size[1] / rows)
            while len(self._slopes) > 1:
                del self._slopes[next(iter(self._slopes))]
            self._slopes[index] = gradient(self.heights[index], spacing, scale=self.metres)
        return self._slopes[index]

    def save(self, path: str | Path) -> None:
        """Write maps and settings to one file; equal maps give equal bytes.

        The file is an .npz (a ZIP of .npy) of two arrays: 'heights', and 'meta' with all settings as UTF-8 JSON. After
        an error an existing file is unchanged.

        Raises:
            DermisError: the file cannot be written.
        """
        meta = {"schema": SCHEMA, "device": self.device.as_dict(), **{name: getattr(self, name) for name in _FIELDS}}
        meta["size"] = list(self.size)
        text = json.dumps(meta, sort_keys=True, indent=1, allow_nan=False).encode()
        arrays = {"meta": np.frombuffer(text, np.uint8), "heights": self.heights.astype("<f4")}
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_STORED) as archive:
            for name, array in arrays.items():
                entry = zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0))
                entry.create_system, entry.external_attr = 3, 0o644 << 16
                member = io.BytesIO()
                np.lib.format.write_array(member, np.ascontiguousarray(array), (1, 0), allow_pickle=False)
                archive.writestr(entry, member.getvalue())
        write_bytes(Path(path), packed.getvalue())

    @classmethod
    def load(cls, path: str | Path) -> ScreenMap:
        """Read a file of `save`.

        Raises:
            DermisError: the file is missing, damaged, or of another version.
        """
        where = f"screen map '{Path(path).name}'"
        with opened_npz(Path(path), where, "a screen map") as archive:
            heights = archive.array("heights")
            meta = json_of(archive.array("meta").tobytes(), where)
        if not isinstance(meta, dict) or meta.get("schema") != SCHEMA:
            found = meta.get("schema") if isinstance(meta, dict) else meta
            raise DermisError("another version of the format", where=where, value=found, limit=SCHEMA)
        wanted = {"schema", "device", *_FIELDS}
        if set(meta) != wanted:
            raise DermisError("fields missing or unknown", where=where, value=", ".join(sorted(set(meta) ^ wanted)))
        if heights.dtype.kind != "f":
            raise DermisError("the heights are not floating-point numbers", where=where, value=str(heights.dtype))
        try:
            width, height = (float(s) for s in meta["size"])
            numbers = {n: float(meta[n]) for n in _FIELDS if n not in ("size", "profile", "downhill")}
        except (TypeError, ValueError, OverflowError) as error:
            raise DermisError("a field is not a number", where=where, value=str(error)) from error
        return cls(
            heights=heights.astype(np.float32),
            size=(width, height),
            device=FrictionScreen.from_dict(meta["device"]),
            profile=meta["profile"],
            downhill=meta["downhill"],
            **numbers,
        )


_FIELDS = (
    "size",
    "height_unit",
    "profile",
    "downhill",
    "scale",
    "offset",
    "threshold",
    "lowest",
    "highest",
    "maps_per_second",
    "start",
    "direction_window",
)


def height_range(heights: Floats32) -> tuple[float, float]:
    """Return the lowest and the highest height of all maps."""
    return float(heights.min()), float(heights.max())


def steepest_of_all(heights: Floats32, size: tuple[float, float], height_unit: float) -> float:
    """Return the steepest slope of all maps, shape (k, rows, columns) [m/m]; one map is processed at a time."""
    return max(_slopes_of_all(heights, size, height_unit))


def _slopes_of_all(heights: Floats32, size: tuple[float, float], height_unit: float) -> Iterator[float]:
    rows, columns = heights.shape[1:]
    buffer = np.empty((2, rows, columns), np.float32)
    for surface in heights:
        spacing = (size[0] / columns, size[1] / rows)
        yield steepest(gradient(surface, spacing, scale=metres_of(size, height_unit), out=buffer))
