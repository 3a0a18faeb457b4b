"""The benchmarks' registry: a function measured, beside its peers, in one run.

A module `bench_*.py` of this folder holds functions like this one::

    @benchmark("gradient_1024_ms", limit=3.5, quick=True)
    def gradient_1024() -> Result:
        ours, peer = measure(lambda: gradient(depth)), measure(lambda: np.gradient(depth))
        return Result("gradient_1024_ms", ours.median, "ms", ours.p95, {"np.gradient": peer.median})

Those marked `quick` run where no names are given, all of them with `--full`. All run in one process: the Blender
environment (bpy, no scipy of its own) with the folder of scipy, onnxruntime and pyserial on PYTHONPATH and one BLAS
thread. A benchmark of the *installed* extension starts processes of its own, which see the wheels in the zip and
nothing else (see bench_register.py). Heavy imports belong inside the functions, so that a module that cannot run costs
one line of the table and not the table.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import gc
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple


@dataclass(frozen=True)
class Result:
    """One line of the table.

    Attributes:
        name: as in the requirements, with its unit at the end, such as 'gradient_1024_ms'.
        value: the median, or None where it could not be measured (then `error` says why).
        unit: of value, p95 and peers.
        p95: the 95th percentile of the same runs.
        peers: what others need for the same work in the same run, in the same unit.
        error: why there is no value, or what is wrong with it.
    """

    name: str
    value: float | None
    unit: str
    p95: float | None = None
    peers: Mapping[str, float] = field(default_factory=dict)
    error: str | None = None


class Benchmark(NamedTuple):
    """A registered function, and what its result is held against.

    Attributes:
        limit: the largest value that is good enough; None: no limit. quick: whether it runs where no names are given.
        tail: how many times the median the 95th percentile may be at most; None: it is not judged.
    """

    name: str
    limit: float | None
    function: Callable[[], Result]
    quick: bool = False
    tail: float | None = None

    def late(self, result: Result) -> bool:
        """Return whether the 95th percentile of a result is beyond `tail`."""
        if self.tail is None or result.value is None or result.p95 is None:
            return False
        return result.p95 > self.tail * result.value


class Timing(NamedTuple):
    """Median and 95th percentile of the runs [ms]."""

    median: float
    p95: float


QUICK_SECONDS = 480.0
REGISTRY: dict[str, Benchmark] = {}


def benchmark(
    name: str, limit: float | None = None, *, quick: bool = False, tail: float | None = None
) -> Callable[[Callable[[], Result]], Callable[[], Result]]:
    """Register a function under a name.

    Args:
        limit: the largest value that is good enough.
        quick: whether it runs where no names are given. All that are quick take less than `QUICK_SECONDS` together.
        tail: how many times the median the 95th percentile may be at most.
    """

    def register(function: Callable[[], Result]) -> Callable[[], Result]:
        if name in REGISTRY:
            raise ValueError(f"two benchmarks are called {name}")
        REGISTRY[name] = Benchmark(name, limit, function, quick, tail)
        return function

    return register


def measure(
    function: Callable[[], Any],
    repeat: int = 21,
    *,
    warmup: int = 2,
    setup: Callable[[], Any] | None = None,
    max_seconds: float = 20.0,
) -> Timing:
    """Time calls of a function with one BLAS thread and the garbage collector at rest.

    Args:
        function: what to time; its result is dropped.
        repeat: how many timed calls, at least 1.
        warmup: calls before them that are not counted (caches, lazy imports).
        setup: called before every call, outside the clock.
        max_seconds: no new timed call starts after this; at least one is made.
    """
    if repeat < 1:
        raise ValueError("repeat must be at least 1")
    times: list[float] = []
    with one_blas_thread():
        for _ in range(warmup):
            if setup is not None:
                setup()
            function()
        collecting = gc.isenabled()
        gc.collect()
        gc.disable()
        try:
            started = time.perf_counter()
            while len(times) < repeat and (not times or time.perf_counter() - started < max_seconds):
                if setup is not None:
                    setup()
                before = time.perf_counter()
                function()
                times.append((time.perf_counter() - before) * 1e3)
        finally:
            if collecting:
                gc.enable()
    return timing(times)


def timing(times: list[float]) -> Timing:
    """Return median and 95th percentile (linear between ranks) of a list of times, in its unit."""
    ranked = sorted(times)

    def quantile(q: float) -> float:
        at = q * (len(ranked) - 1)
        low, high = math.floor(at), math.ceil(at)
        return ranked[low] + (ranked[high] - ranked[low]) * (at - low)

    return Timing(quantile(0.5), quantile(0.95))


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold every OpenBLAS that is already loaded (numpy's, scipy's) at one thread, then restore it.

    OPENBLAS_NUM_THREADS=1 in the environment does the same for those loaded later; the runner sets it.
    """
    restore: list[Callable[[], Any]] = []
    for library in _loaded_openblas():
        for suffix in ("64_", ""):
            for prefix in ("scipy_openblas", "openblas"):
                setter = getattr(library, f"{prefix}_set_num_threads{suffix}", None)
                getter = getattr(library, f"{prefix}_get_num_threads{suffix}", None)
                if setter is not None and getter is not None:
                    count = int(getter())
                    setter(1)
                    restore.append(functools.partial(setter, count))
    try:
        yield
    finally:
        for undo in restore:
            undo()


def _loaded_openblas() -> list[ctypes.CDLL]:
    """Return the OpenBLAS libraries of this process (found on Linux only; elsewhere the environment decides)."""
    if not sys.platform.startswith("linux"):
        return []
    with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
        paths = sorted({line.split(maxsplit=5)[5].strip() for line in maps if "openblas" in line})
    libraries = []
    for path in paths:
        with contextlib.suppress(OSError):
            libraries.append(ctypes.CDLL(path))
    return libraries
