"""What is measured: a point for each setting of a knob, and what the machine was like meanwhile."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from .. import timing

ALIKE = 1.3  # times of the same work may differ by this factor before a run is called noisy


class Point(NamedTuple):
    """One setting of a knob.

    Attributes:
        curve: settings that belong together. knob: what is set.
        median, p95: of the processor's time a frame [ms].
        error: against the reference, relative: discretisation and algebraic together.
        algebraic: against the same method solved tightly, relative; None where it was not looked at.
        default: whether people get this one.
        other: more figures by name.
    """

    curve: str
    knob: str
    median: float
    p95: float
    error: float
    algebraic: float | None = None
    default: bool = False
    other: Mapping[str, float] = {}


@dataclass
class Panel:
    """One diagram.

    Attributes:
        name: of its rows. title: over it. across: what the error is.
        own: the reference's own error: what lies below it says nothing. bands: modelling errors by what they are of.
    """

    name: str
    title: str
    across: str
    points: list[Point] = field(default_factory=list)
    own: float = 0.0
    bands: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        rows = [point._asdict() for point in self.points]
        return {"name": self.name, "title": self.title, "error": self.across, "of_reference": self.own} | {
            "modelling": dict(self.bands),
            "points": rows,
        }


def panel_of(entry: Mapping[str, Any]) -> Panel:
    """Return the diagram that `Panel.as_json` made plain values of."""
    points = [Point(**point) for point in entry["points"]]
    return Panel(entry["name"], entry["title"], entry["error"], points, entry["of_reference"], entry["modelling"])


def clocked(function: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a function returns, and the processor's time that it took [ms]."""
    before = time.process_time_ns()
    made = function()
    return made, (time.process_time_ns() - before) * 1e-6


class Noise:
    """The same piece of work, timed again and again between measurements: how much of a difference is the machine's."""

    def __init__(self) -> None:
        rng = np.random.default_rng(1)
        self._matrix = rng.standard_normal((400, 400))
        self.times: list[float] = []
        self.look()

    def look(self) -> None:
        """Time it once more: products of matrices, and a loop of Python's."""

        def work() -> float:
            total = sum(float((self._matrix @ self._matrix)[0, 0]) for _ in range(4))
            for k in range(60_000):
                total += k % 7
            return total

        self.times.append(min(clocked(work)[1] for _ in range(3)))

    def as_json(self) -> dict[str, Any]:
        """Return what was seen."""
        found = timing(self.times)
        worst = max(self.times) / min(self.times)
        return {
            "same_work_ms": self.times,
            "median": found.median,
            "most_over_least": worst,
            "quiet": worst <= ALIKE,
            "load_average": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        }


def machine() -> dict[str, Any]:
    """Return processor, system and versions."""
    import scipy

    name = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            name = next((line.partition(":")[2].strip() for line in file if line.startswith("model name")), name)
    except OSError:  # no Linux
        pass
    versions = {"python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__}
    for peer in ("daqp", "osqp", "mujoco"):
        try:
            from importlib.metadata import version

            versions[peer] = version(peer)
        except ImportError:
            versions[peer] = "not installed"
    system = f"{platform.system()} {platform.machine()}"
    return {"processor": name, "cores": os.cpu_count(), "system": system, "blas_threads": 1, "versions": versions}
