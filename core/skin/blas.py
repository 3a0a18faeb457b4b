"""One BLAS thread: numpy and scipy each bring a BLAS with a pool of its own, and the pools fight over the cores.

Two threads made a product of a 900 x 900 matrix with a vector 33 times slower on two shared cores. Child processes get
OPENBLAS_NUM_THREADS=1 before numpy loads; inside Blender numpy is loaded already, so the count is set in the library
and restored afterwards.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[Any]:
    """Hold the BLAS of numpy and scipy at one thread while a block runs, then give each back what it had."""
    return pools().limit(limits=1)


@cache
def pools() -> ThreadpoolController:
    """Return what holds the thread pools of every BLAS. Looking them up takes milliseconds, so it is done once."""
    import scipy.linalg  # noqa: F401  (so that its library is there to be found)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")
