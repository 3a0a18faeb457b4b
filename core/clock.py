"""The clock of streams, which also counts while the computer is suspended.

It gives seconds since an arbitrary start. All processes of a computer read the same clock. On Linux and macOS, Python's
own monotonic clocks stop during a suspension. With them, a sender would not notice that its device received no commands
meanwhile.
"""

from __future__ import annotations

import ctypes
import sys
import time
from collections.abc import Callable


def _system_clock() -> Callable[[], float]:
    """Return the system's clock that also counts during suspension [s].

    Systems other than Linux, macOS and Windows have none; then the result is the performance counter.
    """
    if sys.platform == "linux":
        boot = time.CLOCK_BOOTTIME
        return lambda: time.clock_gettime(boot)
    if sys.platform == "darwin":
        monotonic = time.CLOCK_MONOTONIC  # on macOS this clock counts during sleep, unlike mach_absolute_time
        return lambda: time.clock_gettime(monotonic)
    if sys.platform == "win32":
        return _interrupt_time()
    return time.perf_counter


def _interrupt_time() -> Callable[[], float]:
    """Return Windows' clock of the interrupt time [s].

    It also counts during sleep and hibernation.
    """
    read = ctypes.WinDLL("kernelbase").QueryInterruptTimePrecise  # type: ignore[attr-defined]
    read.argtypes, read.restype = [ctypes.POINTER(ctypes.c_ulonglong)], None
    ticks = ctypes.c_ulonglong()
    pointer = ctypes.byref(ticks)

    def now() -> float:
        read(pointer)
        return ticks.value * 1e-7  # Windows counts units of 100 ns

    return now


now = _system_clock()
