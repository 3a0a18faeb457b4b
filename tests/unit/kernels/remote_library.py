"""A library of kernels in another process, called as if it were loaded here: records and arrays go there and back."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from typing import Any

import numpy as np

from core.kernels import records
from tests.kernel_cases.case import SIZES, declared

KINDS: dict[str, type[ctypes.Structure]] = {f"dermis_{name}": record for name, record in records.RECORDS.items()}
ALIGNED = 64


class RemoteLibrary:
    """Calls `dermis_...` functions in a process that runs `calls_dll.c`.

    Args:
        process: of the program, with pipes for standard input and output.
    """

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process

    def __getattr__(self, name: str) -> Callable[[Any], int]:
        if not name.startswith("dermis_"):
            raise AttributeError(name)
        return lambda reference: self._call(name, reference._obj)

    def _call(self, name: str, record: ctypes.Structure) -> int:
        arena, places, pointers = bytearray(), dict[int, int](), list[int]()
        sent: list[tuple[int, ctypes.Structure]] = []

        def place(address: int, size: int, kind: str) -> int:
            """Return where some bytes lie in the arena; they are copied there once, and all that they point to."""
            if address in places:
                return places[address]
            arena.extend(bytes(-len(arena) % ALIGNED))
            places[address] = at = len(arena)
            arena.extend(ctypes.string_at(address, size))
            for first in range(0, size, ctypes.sizeof(KINDS[kind])) if kind in KINDS else ():
                own = KINDS[kind].from_address(address + first)
                sent.append((at + first, own))
                for field in declared(own):
                    target = getattr(own, field.name)
                    if field.type.endswith("*") and target:
                        where = place(target, SIZES[target], field.type.split()[-2])
                        pointers.append(at + first + getattr(type(own), field.name).offset)
                        arena[pointers[-1] : pointers[-1] + 8] = np.int64(where).tobytes()
            return at

        at = place(
            ctypes.addressof(record),
            ctypes.sizeof(record),
            next(kind for kind, own in KINDS.items() if own is type(record)),
        )
        sizes = np.array([len(name), len(arena), len(pointers), at], np.int64)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(sizes.tobytes() + name.encode() + np.array(pointers, np.int64).tobytes() + arena)
        self._process.stdin.flush()
        status = int(np.frombuffer(self._read(8), np.int64)[0])
        back = self._read(len(arena))
        for start, own in sent:
            answered = type(own).from_buffer_copy(back, start)
            for field in declared(own):
                if field.type.endswith("*"):
                    setattr(answered, field.name, getattr(own, field.name))
            ctypes.memmove(ctypes.addressof(own), ctypes.addressof(answered), ctypes.sizeof(own))
        records_at = {ctypes.addressof(own) for _, own in sent}
        for address, start in places.items():
            if address not in records_at:
                ctypes.memmove(address, back[start : start + SIZES[address]], SIZES[address])
        return status

    def _read(self, count: int) -> bytes:
        assert self._process.stdout is not None
        data = self._process.stdout.read(count)
        if len(data) != count:
            raise AssertionError(f"the program ended with {self._process.wait(20)}")
        return data
