"""A disc on skin, and the search for its pose, for the kernels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Array, Indices
from core.kernels import records

from .case import Case, filled


@dataclass(eq=False)
class Pressed(Case):
    """A disc that presses on points of skin, and the step after it."""

    positions: Array
    places: Array
    anchors: Array
    anchored: NDArray[np.bool_]
    sticking: NDArray[np.bool_]
    near: Indices
    compliance: Array
    less: Array | None
    pose: Array
    told: Array
    friction: float
    weight: float
    freedoms: int
    radius, rounding, margin, tolerance, most = 4e-3, 1e-3, 1e-4, 1e-9, 10
    results = "residual", "steps", "strays", "touching"

    def disc(self) -> Any:
        """Return the record of the disc."""
        points, n, free = len(self.positions), len(self.near), self.freedoms
        rows = (3 * self.near[:, None] + np.arange(3)).ravel()
        self.gap, self.answers = np.full(points, np.nan), np.full((n, 3, 1 + free), np.nan)
        self.moved, self.status = np.full((n, 3), np.nan), np.full(n, 7, np.int8)
        part = np.ascontiguousarray(self.compliance[np.ix_(rows, rows)])
        numbers = {"points": points, "count": n, "turning": 2 if free == 3 else free}
        numbers["leading"] = self.told.shape[2] - 1
        work = {"room": np.full((60 + 3 * free + 18 * n) * n, np.nan), "indices": np.full(8 * n, 2**62)}
        out = {"answer": self.answers, "offset": np.full((n, 3), np.nan)}
        return filled(records.DiscRecord, self, compliance=part, **numbers, **work, **out)

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        points, n, free, record = len(self.positions), len(self.near), self.freedoms, self.disc()
        status = self._call(own.dermis_press_disc, record, **changed)
        yield status
        if status or record.strays:
            return
        after = {"moved": np.full((points, 3), np.nan), "force": np.full((points, 3), np.nan)}
        after |= {"anchor": np.full((points, 2), np.nan), "sticks": np.full(points, 7, np.uint8)}
        fixed = {"points": points, "count": n, "width": 1 + free, "answer": self.answers}
        yield self._call(own.dermis_settle_disc, filled(records.SettledRecord, self, **fixed, **after))


def drawn_pressed(seed: int) -> Pressed:
    """Return a bowl of skin and a disc: above it, touching or deep, with and without friction, anchors and history."""
    rng = np.random.default_rng(seed)
    points, free = int(rng.integers(4, 40)), 6 if seed % 3 == 0 else 3
    flat = rng.uniform(-6e-3, 6e-3, (points, 2))
    positions = np.column_stack([flat, 12.0 * (flat**2).sum(axis=1)])
    places = positions + 1e-4 * rng.normal(size=(points, 3))
    reach = np.linalg.norm(positions[:, None] - positions, axis=2)
    spread = np.exp(-((reach / 3e-3) ** 2)) + 0.2 * np.eye(points)
    compliance = np.ascontiguousarray(np.kron(spread, np.diag([1.0, 1.2, 0.8]))) * 1e-3
    anchored = rng.random(points) < 0.8 if seed % 2 else np.zeros(points, np.bool_)
    sticking = anchored & (rng.random(points) < 0.5)
    anchors = np.where(anchored[:, None], flat + 1e-4 * rng.normal(size=(points, 2)), 0.0)
    turn = np.linalg.qr(np.eye(3) + 0.1 * rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.diag(turn))
    centre = np.array([*(5e-4 * rng.normal(size=2)), float(rng.choice([-1e-3, 2e-4, 1e-3]))])
    spin, shift = rng.normal(size=(free, 3)), rng.normal(size=(3, free))
    if free == 3:
        spin[2] = 0.0
    pose = np.concatenate([turn.ravel(), centre, spin.ravel(), shift.ravel(), 1e-5 * rng.normal(size=free)])
    near = np.arange(points) if seed % 5 else np.flatnonzero(rng.random(points) < 0.9)
    told = 0.01 * rng.normal(size=(len(near), 3, 1 + free * (seed % 2)))
    less = 1e-5 * rng.normal(size=(points, 3)) if seed % 4 == 0 else None
    friction, weight = float(rng.choice([0.0, 0.4, 1.0])), 1.0 / float(np.median(np.diag(compliance)))
    fixed = positions, places, anchors, anchored, sticking, near, compliance, less, pose, told
    return Pressed(*fixed, friction, weight, free)


@dataclass(eq=False)
class Searched(Case):
    """A search for a thimble's pose: of a disc on points of skin, or of a map that the caller evaluates.

    Attributes:
        pressed: disc and points; None for the map.
        matrix: of the map from pitch, roll, and distance over 0.01 m (k, 3).
        observation: of the disc's contact (points, 3, k).
        earlier: target and derivative of an earlier search that ended at the start; None for none.
    """

    pressed: Pressed | None
    matrix: Array
    observation: Array
    target: Array
    x: Array
    low: Array
    high: Array
    earlier: tuple[Array, Array] | None
    bounded: int
    follows: int
    foreseen: float
    least: float = 0.03
    most_evaluations: int = 16
    reach, optimal, small_step, exact, small_gain, hardly, later = 1.0, 3e-3, 1e-4, 1e-6, 1e-3, 2.5e-3, 1e-2
    least_reach, nearly, shortest, longest, armijo, damping, most_steps = 0.25, 0.8, 1.0 / 64.0, 0.35, 1e-4, 1e-9, 20
    on_limit = 1e-9
    results = (
        "x",
        "at",
        "pose",
        "room",
        "angles",
        "slopes",
        "multipliers",
        "active",
        "actives",
        "bounded",
        "why",
        "own",
    )
    results += ("held", "residual", "steps", "reach", "start_cost", "cost", "kkt", "iterations", "evaluations")

    def value(self, x: Array) -> tuple[Array, Array]:
        """Return the map at a configuration, shape (k,), and its derivative, shape (3, k).

        They are rounded once, and in the same way in every floating-point environment.
        """
        if not (np.abs(self.matrix) < 1e100).all():
            return np.full(len(self.matrix), np.nan), np.full((3, len(self.matrix)), np.nan)
        units, middle = (1, 1, 100), (0, 0, Fraction(18, 1000))
        at = [unit * (Fraction(v) - zero) for unit, v, zero in zip(units, x.tolist(), middle, strict=True)]
        rows = [[Fraction(v) for v in row] for row in self.matrix.tolist()]
        y = [sum((a * b for a, b in zip(row, at, strict=True)), Fraction(0)) for row in rows]
        slopes = [
            [float(unit * row[j] * (1 + v)) for row, v in zip(rows, y, strict=True)] for j, unit in enumerate(units)
        ]
        return np.array([float(v + v * v / 2) for v in y]), np.array(slopes)

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        size = len(self.target)
        mount = [-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.018]
        links = {"platform_radius": 0.01, "base_radius": 0.015, "crank": 0.01, "rod": 0.02, "bend": 1.0, "side": 1.0}
        thimble = filled(records.ThimbleRecord, servo_zero=0.4024712149242631, least=self.least, mount=mount, **links)
        arrays: dict[str, Any] = {name: np.full((4, size), np.nan) for name in ("values", "trial_values")}
        arrays["answer"] = None
        if self.earlier is not None:
            arrays |= dict(zip(("before", "slope"), self.earlier, strict=True))
        disc = None
        if self.pressed is not None:
            disc, n = self.pressed.disc(), len(self.pressed.near)
            arrays |= {"answer": np.full((n, 3, 4), np.nan), "moved": np.full((n, 3), np.nan)}
            arrays |= {"status": np.full(n, 7, np.int8)}
        record = filled(records.SearchRecord, self, thimble=thimble, disc=disc, size=size, **arrays)
        status = self._call(own.dermis_descend, record, **changed)
        while status == records.ASKS and disc is None:
            arrays["trial_values"][0], arrays["trial_values"][1:] = self.value(np.array(record.trial))
            status = self._call(own.dermis_descend, record)
        yield records.DONE if status == records.ASKS else status  # Newton's method does not solve a contact


def drawn_search(seed: int) -> Searched:
    """Return a search within wide or narrow limits, alone or after another one, by a disc or a map."""
    rng = np.random.default_rng(seed)
    k, pressed = int(rng.integers(3, 20)), drawn_pressed(6 * seed + 1) if seed % 2 else None
    points = 1 if pressed is None else len(pressed.positions)
    if pressed is not None:
        pressed.near, pressed.told = np.arange(points), np.zeros((points, 3, 1))
    x = np.array([*rng.uniform(-0.1, 0.1, 2), 0.018 - rng.uniform(0.0, 1e-3)])
    matrix = rng.normal(size=(k, 3))
    target = 0.3 * matrix @ rng.normal(size=3) + 0.1 * rng.normal(size=k)
    slope = np.ascontiguousarray(matrix.T) * np.array([[1.0], [1.0], [100.0]])
    earlier = (target + 0.01 * rng.normal(size=k), slope) if seed % 3 else None
    wide = 0.7 if seed % 4 < 2 else 0.1
    limits = np.full(3, -wide), np.full(3, wide)
    observation = rng.normal(size=(points, 3, k))
    foreseen = 0.02 if seed % 5 == 0 else 0.0
    return Searched(pressed, matrix, observation, target, x, *limits, earlier, seed % 7 == 0, seed % 3 == 0, foreseen)
