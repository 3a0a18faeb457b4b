"""Damaged files for every reader of the table, and what is no refusal: other exceptions, long times, large memory."""

from __future__ import annotations

import time
import traceback
import zlib
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from core.errors import DermisError

from .damage import Damager
from .readers import Reader

SLOWEST, LARGEST = 2.0, 500  # of one file [s], [MB]


@dataclass
class Found:
    """What a run of damaged files brought.

    Attributes:
        tried: files. accepted: of them by reader.
        others: what was no refusal: reader, exception and place, with counts.
    """

    tried: int = 0
    accepted: Counter[str] = field(default_factory=Counter)
    others: Counter[str] = field(default_factory=Counter)


def fuzz(readers: Iterable[Reader], count: int, seed: int, folder: Path) -> Found:
    """Let every reader read so many damaged files; a whole one first, which must be read."""
    found = Found()
    for reader in readers:
        own = folder / reader.name.replace(" ", "-").replace(",", "")
        own.mkdir()
        path = own / f"file{reader.suffix}"
        damager = Damager(zlib.crc32(reader.name.encode()) ^ seed)
        seeds = reader.seeds()
        reader.beside(path)
        for whole in seeds:
            path.write_bytes(whole)
            reader.read(path)
        memory = largest_memory()
        for i in range(count):
            path.write_bytes(damager.damage(seeds[i % len(seeds)]))
            found.tried += 1
            started = time.process_time()  # a busy machine takes no more of it
            if attempt(reader, path, found):
                found.accepted[reader.name] += 1
            if time.process_time() - started > SLOWEST:
                found.others[f"{reader.name}: more than {SLOWEST} s"] += 1
            grown, memory = largest_memory() - memory, largest_memory()
            if grown > LARGEST:
                found.others[f"{reader.name}: more than {LARGEST} MB"] += 1
    return found


def attempt(reader: Reader, path: Path, found: Found) -> bool:
    """Read one file; tell whether it was accepted, and note what is neither that nor a refusal in words."""
    try:
        reader.read(path)
        return True
    except DermisError as error:
        str(error).encode("utf-8", "backslashreplace")
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        found.others[f"{reader.name}: {type(error).__name__} at {Path(last.filename).name}:{last.lineno}"] += 1
    return False


def largest_memory() -> float:
    """Return the most memory that this process ever had [MB]; 0 where the system does not tell."""
    try:
        import resource
    except ImportError:
        return 0.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
