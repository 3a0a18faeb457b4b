"""One BLAS thread: numpy and scipy each bring a BLAS with a pool of its own, and the pools fight over the cores.

Two threads made a product of a 900 x 900 matrix with a vector 33 times slower on two shared cores. Child processes get
OPENBLAS_NUM_THREADS=1 before numpy loads; inside Blender numpy is loaded already, so the count is set in the library
and restored afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


_held = 0


@contextmanager
def one_thread() -> Iterator[None]:
    """Hold the BLAS of numpy and scipy at one thread while a block runs, then give each back what it had.

    Asking the libraries takes a fifth of a millisecond, so only the outermost of nested blocks does.
    """
    global _held
    with pools().limit(limits=1) if not _held else nullcontext():
        _held += 1
        try:
            yield
        finally:
            _held -= 1


@cache
def pools() -> ThreadpoolController:
    """Return what holds the thread pools of every BLAS. Looking them up takes milliseconds, so it is done once."""
    import scipy.linalg  # noqa: F401  (so that its library is there to be found)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")
