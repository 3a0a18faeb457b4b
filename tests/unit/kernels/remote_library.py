"""A library of kernels in another process, called as if it were loaded here: records and arrays go there and back."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from typing import Any

import numpy as np

from core.kernels import records
from tests.kernel_arrays import SIZES

KINDS = {"tree": records.TreeRecord, "all": records.TreeRecord, "body": records.BodyRecord, "next": records.BodyRecord}
KINDS |= {"field": records.PatchesRecord, "source": records.PatchesRecord}
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
        kept: list[ctypes.Structure] = []

        def place(address: int, size: int) -> int:
            """Return where some bytes lie in the arena; they are copied there once."""
            if address not in places:
                arena.extend(bytes(-len(arena) % ALIGNED))
                places[address] = len(arena)
                arena.extend(ctypes.string_at(address, size))
            return places[address]

        def packed(own: ctypes.Structure) -> int:
            address = ctypes.addressof(own)
            if address in places:
                return places[address]
            at = place(address, ctypes.sizeof(own))
            kept.append(own)
            for field, kind in ((f[0], f[1]) for f in own._fields_):
                target = getattr(own, field)
                if kind is not ctypes.c_void_p or not target:
                    continue
                inner = KINDS.get(field)
                where = place(target, SIZES[target]) if inner is None else packed(inner.from_address(target))
                own_place = at + getattr(type(own), field).offset
                arena[own_place : own_place + 8] = np.int64(where).tobytes()
                pointers.append(own_place)
            return at

        at = packed(record)
        sizes = np.array([len(name), len(arena), len(pointers), at], np.int64)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(sizes.tobytes() + name.encode() + np.array(pointers, np.int64).tobytes() + arena)
        self._process.stdin.flush()
        status = int(np.frombuffer(self._read(8), np.int64)[0])
        back = self._read(len(arena))
        of_records = {ctypes.addressof(own): own for own in kept}
        for address, start in places.items():
            own = of_records.get(address)
            if own is None:
                ctypes.memmove(address, back[start : start + SIZES[address]], SIZES[address])
                continue
            answered = type(own).from_buffer_copy(back, start)
            for field, kind in ((f[0], f[1]) for f in own._fields_):
                if kind is not ctypes.c_void_p:
                    setattr(own, field, getattr(answered, field))
        return status

    def _read(self, count: int) -> bytes:
        assert self._process.stdout is not None
        data = self._process.stdout.read(count)
        if len(data) != count:
            raise AssertionError(f"the program ended with {self._process.wait(20)}")
        return data
