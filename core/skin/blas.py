"""Restriction of BLAS to one thread.

NumPy and SciPy each have a BLAS with its own thread pool, and the pools compete for the cores. On two shared cores, two
threads made the product of a 900 x 900 matrix with a vector 33 times slower. Child processes get OPENBLAS_NUM_THREADS=1
before NumPy is loaded. Inside Blender NumPy is loaded already, so the number of threads is set in the library and
restored afterwards.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


_lock = threading.Lock()
_held = 0  # number of running blocks in all threads
_limit: Any = None  # the limit of threadpoolctl while it is set
_holder: threading.Thread | None = None  # the thread that set the limit, which alone can restore it


@contextmanager
def one_thread() -> Iterator[None]:
    """Restrict the BLAS of NumPy and SciPy to one thread while a block runs.

    Blocks may be nested and may run in several threads. The first block sets the limit, which takes a fifth of a
    millisecond. The last block restores the number of threads if it ends in the thread that set the limit, or if that
    thread has ended. Otherwise the limit stays until a later last block meets this condition.
    """
    global _held, _limit, _holder
    with _lock:
        if _limit is None:
            _limit, _holder = pools().limit(limits=1), threading.current_thread()
            _limit.__enter__()
        _held += 1
    try:
        yield
    finally:
        with _lock:
            _held -= 1
            if not _held:
                _restore()


def _restore() -> None:
    global _limit, _holder
    if _holder is not threading.current_thread():
        if _holder is not None and _holder.is_alive():
            return
        _limit.__enter__()
    _limit.__exit__(None, None, None)
    _limit = _holder = None


@cache
def pools() -> ThreadpoolController:
    """Return the controller of all BLAS thread pools.

    It takes milliseconds to find the pools, so the controller is kept.
    """
    import scipy.linalg  # noqa: F401  (loads its library, so that it is found)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")
