"""Restriction of BLAS to one thread, and eigenvectors without Python's lock.

NumPy and SciPy each have a BLAS with its own thread pool, and the pools compete for the cores. On two shared cores, two
threads made the product of a 900 x 900 matrix with a vector 33 times slower. Child processes get OPENBLAS_NUM_THREADS=1
before NumPy is loaded. Inside Blender NumPy is loaded already, so the number of threads is set in the library and
restored afterwards.
"""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


ONE_THREAD = "OPENBLAS_NUM_THREADS", "1"  # variable that OpenBLAS reads when it is loaded, and its value in a child
_INTEGERS = 11  # arguments of LAPACK's dsyevr that are integers or arrays of them
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

    It takes milliseconds to find the pools, so the controller is kept. In a child process, SciPy's library needs no
    limit when it is loaded later, and it is not loaded here: that takes a tenth of a second.
    """
    if os.environ.get(ONE_THREAD[0]) != ONE_THREAD[1]:
        import scipy.linalg  # noqa: F401  (loads its library, so that it is found)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


def symmetric_eigenvectors(matrix: Array) -> tuple[Array, Array]:
    """Return the eigenvalues and eigenvectors of a symmetric matrix, to the last bit those of `scipy.linalg.eigh`.

    SciPy keeps Python's lock while LAPACK computes, so no other thread runs, and no window is drawn: for 700 rows that
    takes a quarter of a second. This function calls the same routine of the same library without the lock.

    Args:
        matrix: a symmetric matrix, shape (n, n). Its lower triangle is read.

    Returns:
        Eigenvalues in rising order, shape (n,), and the eigenvectors as columns, shape (n, n).

    Raises:
        ValueError: the matrix is not finite.
        numpy.linalg.LinAlgError: the eigenvalues were not found.
    """
    dsyevr = _dsyevr()
    if dsyevr is None:
        from scipy.linalg import eigh

        found: tuple[Array, Array] = eigh(matrix)
        return found
    given = np.asarray_chkfinite(matrix, np.float64)
    rows = len(given)
    values, vectors = np.empty(rows), np.empty((rows, rows), order="F")
    own, support = np.array(given, order="F"), np.empty(2 * rows, np.intc)
    number, first, count, failed = (ctypes.c_int(k) for k in (rows, 1, 0, 0))
    zero = ctypes.c_double()
    n, one, none = ctypes.byref(number), ctypes.byref(first), ctypes.byref(zero)

    def compute(work: Array, whole: NDArray[np.intc], lengths: tuple[int, int]) -> None:
        of_work, of_whole = (ctypes.byref(ctypes.c_int(length)) for length in lengths)
        # All eigenvalues, at the least tolerance; the limits of a range are not read.
        limits = (none, none, one, n, none)
        into = (ctypes.byref(count), values.ctypes.data, vectors.ctypes.data, n, support.ctypes.data)
        room = (work.ctypes.data, of_work, whole.ctypes.data, of_whole, ctypes.byref(failed))
        dsyevr(b"V", b"A", b"L", n, own.ctypes.data, n, *limits, *into, *room)
        if failed.value:
            raise np.linalg.LinAlgError(f"eigenvalues were not found: dsyevr returned {failed.value}")

    work, whole = np.empty(1), np.empty(1, np.intc)
    compute(work, whole, (-1, -1))  # returns the best lengths of the work arrays
    lengths = int(work[0]), int(whole[0])
    compute(np.empty(lengths[0]), np.empty(lengths[1], np.intc), lengths)
    return values, vectors


@cache
def _dsyevr() -> Any:
    """Return LAPACK's routine as SciPy offers it to Cython; None if its integers are not C's int."""
    from scipy.linalg import cython_lapack

    capsule = cython_lapack.__pyx_capi__["dsyevr"]
    api = ctypes.pythonapi
    api.PyCapsule_GetName.restype, api.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
    api.PyCapsule_GetPointer.restype = ctypes.c_void_p
    api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    name = api.PyCapsule_GetName(capsule)  # the types of its arguments
    if name.count(b", int *") != _INTEGERS:
        return None
    place = api.PyCapsule_GetPointer(capsule, name)
    return ctypes.CFUNCTYPE(None, *[ctypes.c_char_p] * 3, *[ctypes.c_void_p] * 18)(place)
