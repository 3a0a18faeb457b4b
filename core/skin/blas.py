"""One BLAS thread: numpy and scipy each bring a BLAS with a pool of its own, and the pools fight over the cores.

Two threads made a product of a 900 x 900 matrix with a vector 33 times slower on two shared cores. Child processes get
OPENBLAS_NUM_THREADS=1 before numpy loads; inside Blender numpy is loaded already, so the count is set in the library
and restored afterwards.
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
_held = 0  # blocks that run, in whichever thread
_limit: Any = None  # of threadpoolctl, while the libraries are held at one thread
_holder: threading.Thread | None = None  # the thread that set it: from another one the libraries take no count


@contextmanager
def one_thread() -> Iterator[None]:
    """Hold the BLAS of numpy and scipy at one thread while a block runs, then give each back what it had.

    Blocks may be nested and may run in several threads: the first one sets the count, which takes a fifth of a
    millisecond, and the last one restores it. Where that one may not, the next block of the thread that set it does.
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
    """Return what holds the thread pools of every BLAS. Looking them up takes milliseconds, so it is done once."""
    import scipy.linalg  # noqa: F401  (so that its library is there to be found)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")
