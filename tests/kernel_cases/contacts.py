"""Contact between nodes and its friction for the kernels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Array
from core.kernels import records

from .case import Case, filled

GIVEN = "compliance", "offset", "normals", "friction", "softness", "force"  # of a contact


@dataclass(eq=False)
class Contact(Case):
    """The arrays of a contact."""

    compliance: Array
    offset: Array
    normals: Array
    friction: Array
    softness: Array
    force: Array
    tolerance: float = 1e-9
    most: int = 60
    results = "residual", "sweeps", "wrong"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        n = len(self.force)
        step = self.compliance.itemsize
        self.image, self.moved = np.full((2, n, 3), np.nan)
        numbers = {"count": n, "single": step == 4, "stride": self.compliance.strides[0] // step}
        room = np.full(records.SWEEP_ROOM * n, np.nan)
        status = np.full(n, -7, dtype=np.int8)
        record = filled(records.ContactRecord, self, **numbers, room=room, status=status)
        yield self._call(own.dermis_sweep, record, **changed)


def drawn_contact(seed: int) -> Contact:
    """Return nodes of all kinds: few and many, without friction and with much, soft ones, and some far from all."""
    rng = np.random.default_rng(seed)
    n, scale = int(rng.integers(1, 40)), 10.0 ** rng.uniform(-5, -1)
    basis = rng.normal(size=(3 * n, 6 * n))
    compliance = scale * (basis @ basis.T / (6 * n) + 0.1 * np.eye(3 * n))
    room = np.full((3 * n, 3 * n + int(rng.integers(0, 9))), np.nan)
    room[:, : 3 * n] = compliance
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[rng.random(n) < 0.1] = 0.0
    offset = rng.normal(size=(n, 3)) * 1e-3 - 5e-4 * normals
    friction = rng.choice([0.0, 0.3, 1.0, 5.0], n)
    softness = np.where(rng.random(n) < 0.3, scale * rng.random(n), 0.0)
    start = rng.normal(size=(n, 3)) * (seed % 2)
    compliance = room.astype(np.float32) if seed % 3 else room
    return Contact(compliance, offset, normals, friction, softness, start)


@dataclass(eq=False)
class Friction(Case):
    """The friction history of some nodes, and a frame."""

    arrays: dict[str, Array]
    radius, share, drift, passed = 1e-3, 0.7, (1e-4, -2e-4, 0.0), (2e-4, 1e-4, 1e-5)
    results = "drift", "passed", "shifted", "slides", "normal", "tangential", "depth", "slide", "sticking", "slipping"

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        arrays, n = self.arrays, len(self.arrays["gap"])
        numbers = {"count": n, "bodies": len(arrays["poses"]), "entered": len(arrays["entering"])}
        record = filled(records.FrictionRecord, self, **numbers, **arrays)
        for function in (own.dermis_expect, own.dermis_offset, own.dermis_foresee, own.dermis_keep, own.dermis_drift):
            yield self._call(function, record, **changed)
            changed = {}
        given = {name: arrays[name] for name in ("points", "force", "image", "gaps", "status")}
        frame = {"normals": arrays["facing"], "displacement": arrays["moved"], **given}
        self.sums = filled(records.SumsRecord, count=n, from_rest=n % 2, **frame)
        yield self._call(own.dermis_sum, self.sums)


@dataclass(eq=False)
class Arrivals(Case):
    """Nodes of which some come into contact."""

    arrays: dict[str, Array]
    compliance: NDArray[np.float32]
    results = ("entered",)

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        n, arrays = len(self.compliance) // 3, self.arrays
        self.entering, self.crossing = np.full(n, -7), np.full((n, 3), np.nan)
        names = "status", "loaded", "owner", "below", "friction", "moved", "force", "gap", "soft"
        given = {name: arrays[name] for name in names} | {"normals": arrays["facing"]}
        numbers = {"count": n, "stride": self.compliance.shape[1]}
        yield self._call(own.dermis_arrive, filled(records.ArrivalsRecord, self, **given, **numbers), **changed)


def drawn_arrivals(seed: int) -> Arrivals:
    """Return the nodes of `drawn_friction` and a compliance."""
    rng, arrays = np.random.default_rng(seed), drawn_friction(seed).arrays
    n = len(arrays["gap"])
    return Arrivals(arrays, (1e-3 * rng.normal(size=(3 * n, 3 * n + seed % 4))).astype(np.float32))


def drawn_friction(seed: int) -> Friction:
    """Return nodes that stick, slip and are off three bodies, of which one is stretched and one may be away."""
    rng = np.random.default_rng(seed)
    n, scale = int(rng.integers(1, 60)), 10.0 ** rng.uniform(-5, -2)
    poses = np.zeros((3, records.POSE))
    for k, row in enumerate(poses):
        carry = np.eye(3) + (k == 1) * 0.2 * rng.normal(size=(3, 3))
        row[:9], row[9:12] = np.linalg.qr(rng.normal(size=(3, 3)))[0].ravel(), scale * rng.normal(size=3)
        row[12:21], row[21:30] = carry.ravel(), np.linalg.inv(carry).ravel()
    poses[2, 30] = seed % 2
    owner, below = rng.integers(-1, 2 + seed % 3 // 2, (2, n))
    below[: n // 2] = owner[: n // 2]
    facing = rng.normal(size=(n, 3))
    facing /= np.linalg.norm(facing, axis=1)[:, None]
    force = np.where(rng.random((n, 1)) < 0.7, facing + 0.3 * rng.normal(size=(n, 3)), 0.0)
    arrays: dict[str, Array] = {"poses": poses, "owner": owner, "below": below, "facing": facing, "force": force}
    for name in ("material", "normal", "slip", "swept", "points", "image", "moved", "offset"):
        arrays[name] = scale * rng.normal(size=(n, 3))
    for name in ("anchors", "normals", "places", "sweeping", "shift", "positions", "crossing"):
        arrays[name] = scale * rng.normal(size=(n, 3))
    for name in ("gap", "gaps", "own", "soft", "friction"):
        arrays[name] = scale * rng.random(n) - (name == "gaps") * scale / 2
    for name in ("triangle", "faces", "nodes"):
        arrays[name] = rng.integers(0, 99, n)
    arrays["corners"], arrays["entering"] = rng.integers(0, 99, (n, 3)), rng.permutation(n)[: n // 4]
    for name in ("sticking", "loaded", "renewed"):
        arrays[name] = rng.integers(0, 2, n).astype(np.uint8)
    arrays["status"] = rng.integers(0, 3, n).astype(np.int8)
    return Friction(arrays)
