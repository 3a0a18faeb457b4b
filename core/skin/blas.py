"""One BLAS thread: numpy and scipy each bring an OpenBLAS with a pool of its own, and the pools fight over the cores.

Two threads made a product of a 900 x 900 matrix with a vector 33 times slower on two shared cores. Child processes get
OPENBLAS_NUM_THREADS=1 before numpy loads; inside Blender numpy is loaded already, so the count is set in the library
and restored afterwards. Where no OpenBLAS is found (Accelerate, MKL, none at all) nothing happens.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path

_NAMES = tuple(
    (f"{prefix}_get_num_threads{suffix}", f"{prefix}_set_num_threads{suffix}")
    for prefix in ("scipy_openblas", "openblas")
    for suffix in ("64_", "")
)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Hold every OpenBLAS of numpy and scipy at one thread, then give it back what it had. Takes some ms."""
    before = [(put, get()) for get, put in controls()]
    try:
        for put, _ in before:
            put(1)
        yield
    finally:
        for put, count in before:
            put(count)


def thread_counts() -> tuple[int, ...]:
    """Return how many threads each OpenBLAS uses."""
    return tuple(get() for get, _ in controls())


def controls() -> list[tuple[Callable[[], int], Callable[[int], None]]]:
    """Return getter and setter of each OpenBLAS: on Linux of those in the process now."""
    found = []
    for path in _libraries():
        try:
            library = ctypes.CDLL(str(path))
        except OSError:
            continue
        for get_name, set_name in _NAMES:
            get, put = getattr(library, get_name, None), getattr(library, set_name, None)
            if get is not None and put is not None:
                get.restype, get.argtypes, put.restype, put.argtypes = ctypes.c_int, [], None, [ctypes.c_int]
                found.append((get, put))
                break
    return found


def _libraries() -> list[Path]:
    """Return the files of the OpenBLAS libraries."""
    with contextlib.suppress(OSError), open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
        return sorted({Path(line.split(maxsplit=5)[5].strip()) for line in maps if "openblas" in line})
    # No such table outside Linux, but wheels keep their libraries in known folders.
    paths: set[Path] = set()
    for name in ("numpy", "scipy"):
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.origin is not None:
            package = Path(spec.origin).parent
            for folder in (package.parent / f"{name}.libs", package / ".dylibs"):
                paths.update(folder.glob("*openblas*"))
    return sorted(paths)
