"""The clock of a stream: seconds from an arbitrary start, which go on while the computer is suspended.

Python's own monotonic clocks stand still during a suspension on Linux and macOS, so a sender that reads them cannot
tell that its device was left alone meanwhile. Processes of one computer read the same clock.
"""

from __future__ import annotations

import ctypes
import sys
import time
from collections.abc import Callable


def _system_clock() -> Callable[[], float]:
    """Return this system's clock that counts suspension; the performance counter where there is none."""
    if sys.platform == "linux":
        boot = time.CLOCK_BOOTTIME
        return lambda: time.clock_gettime(boot)
    if sys.platform == "darwin":
        monotonic = time.CLOCK_MONOTONIC  # on macOS it goes on during sleep, mach_absolute_time does not
        return lambda: time.clock_gettime(monotonic)
    if sys.platform == "win32":
        return _interrupt_time()
    return time.perf_counter


def _interrupt_time() -> Callable[[], float]:
    """Return Windows' interrupt time, which counts sleep and hibernation, in units of 100 ns."""
    read = ctypes.WinDLL("kernelbase").QueryInterruptTimePrecise  # type: ignore[attr-defined]
    read.argtypes, read.restype = [ctypes.POINTER(ctypes.c_ulonglong)], None
    ticks = ctypes.c_ulonglong()
    pointer = ctypes.byref(ticks)

    def now() -> float:
        read(pointer)
        return ticks.value * 1e-7

    return now


now = _system_clock()
