"""What is measured: a point for each setting of a knob, and what the machine was like meanwhile."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
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
        discretisation: of the same method solved tightly against the reference; None where it was not looked at. Of
            the model of tissue nothing is in these: that is a diagram's `bands`.
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
    discretisation: float | None = None


@dataclass
class Panel:
    """One diagram.

    Attributes:
        name: of its rows. title: over it. across: what the error is.
        own: the reference's own error: what lies below it says nothing. bands: modelling errors by what they are of.
        each: what the time is of [ms].
    """

    name: str
    title: str
    across: str
    points: list[Point] = field(default_factory=list)
    own: float = 0.0
    bands: Mapping[str, float] = field(default_factory=dict)
    each: str = "ms a frame"

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        rows = [point._asdict() for point in self.points]
        told = {"name": self.name, "title": self.title, "error": self.across, "of_reference": self.own}
        return {**told, "modelling": dict(self.bands), "each": self.each, "points": rows}


def panel_of(entry: Mapping[str, Any]) -> Panel:
    """Return the diagram that `Panel.as_json` made plain values of."""
    points = [Point(**point) for point in entry["points"]]
    known = entry["of_reference"], entry["modelling"], entry["each"]
    return Panel(entry["name"], entry["title"], entry["error"], points, *known)


def clocked(function: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a function returns, and the processor's time that it took [ms]."""
    before = time.process_time_ns()
    made = function()
    return made, (time.process_time_ns() - before) * 1e-6


class Noise:
    """The same piece of work, timed again and again between measurements: how much of a difference is the machine's.

    Attributes:
        times: of the processor [ms]. waited: the wall's time over it, more than one where others wanted the core too.
    """

    def __init__(self) -> None:
        rng = np.random.default_rng(1)
        self._matrix = rng.standard_normal((400, 400))
        self.times: list[float] = []
        self.waited: list[float] = []
        self.look()

    def look(self) -> None:
        """Time it once more: products of matrices, and a loop of Python's."""

        def work() -> float:
            total = sum(float((self._matrix @ self._matrix)[0, 0]) for _ in range(4))
            for k in range(60_000):
                total += k % 7
            return total

        started = time.perf_counter_ns()
        taken = [clocked(work)[1] for _ in range(3)]
        self.waited.append((time.perf_counter_ns() - started) * 1e-6 / max(sum(taken), 1e-6))
        self.times.append(min(taken))

    def as_json(self) -> dict[str, Any]:
        """Return what was seen."""
        found = timing(self.times)
        worst, waited = max(self.times) / min(self.times), timing(self.waited).median
        return {
            "same_work_ms": self.times,
            "median": found.median,
            "most_over_least": worst,
            "wall_over_processor": waited,
            "quiet": worst <= ALIKE and waited <= ALIKE,
            "load_average": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        }


PEERS = ("daqp", "osqp", "proxsuite", "quadprog", "scikit-fem", "mujoco-core")


def machine() -> dict[str, Any]:
    """Return processor, system and versions, and whose linear algebra numpy calls."""
    name = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            name = next((line.partition(":")[2].strip() for line in file if line.startswith("model name")), name)
    except OSError:  # no Linux
        pass
    versions = {"python": platform.python_version(), "numpy": np.__version__}
    for package in ("scipy", *PEERS):
        try:
            versions[package] = version(package)
        except ImportError:
            versions[package] = "not installed"
    system = f"{platform.system()} {platform.machine()}"
    told = {"processor": name, "cores": os.cpu_count(), "system": system, "blas": blas(), "blas_threads": 1}
    return {**told, "versions": versions}


def blas() -> str:
    """Return the library that numpy's products of matrices are made by, 'none' where it has its own loops."""
    built = np.show_config(mode="dicts")
    found = (built or {}).get("Build Dependencies", {}).get("blas", {})
    return " ".join(str(found[key]) for key in ("name", "version") if found.get(key)) or "none"
