"""`python -m core thimble adapt`: learn a thimble's effect on fingers.

Several fingers are learned in parallel.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import FIRST_COMPLETED, wait
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from ..files import write_bytes
from ..parameters.error_bands import LINEAR
from ..presets import Library
from ..surrogate.lessons import KINDS
from ..work.executor import POLL_SECONDS, JobFuture
from .workers import executor_of, tell_unlike


def run(options: argparse.Namespace) -> int:
    """Learn a surrogate for each skin, and write it; return the exit status.

    The status is 0, 1 if some skins were refused, and 2 if all were.
    """
    library = Library(options.presets)
    more = {} if options.movements is None else {"trajectories": options.movements}
    device = {"device": library.load("devices", options.device), "device_key": options.device}
    how = {**device, "level": options.level, "tissue": options.tissue, **more}
    skins = {skin: library.skin(skin) for skin in options.skin}  # all are read before any is learned
    refused = 0
    with executor_of(options) as executor:
        every = {skin: executor.submit("adapt", {}, {**how, "skin": values}) for skin, values in skins.items()}
        waiting, shown = dict(every), -1
        while waiting:
            wait(waiting.values(), POLL_SECONDS, FIRST_COMPLETED)
            for skin in [skin for skin, future in waiting.items() if future.done()]:
                refused += not _told(skin, waiting.pop(skin), options.out, options.tissue != LINEAR)
            tenths = int(10 * sum(map(_share, every.values())) / len(every))
            if tenths != shown and not options.quiet:
                print(f"{10 * tenths} %", file=sys.stderr)
            shown = tenths
        tell_unlike(executor)
    return 0 if not refused else 2 if refused == len(skins) else 1


def _share(future: JobFuture) -> float:
    done, total = future.progress()
    return 1.0 if future.done() else done / max(total, 1)


def _told(skin: str, future: JobFuture, folder: Path, by_law: bool) -> bool:
    """Write the learned model of a skin and print its errors.

    If the skin was refused, print the reason. Return whether a model was written.
    """
    try:
        made = future.result()
    except DermisError as error:
        print(f"error: {skin}: {error}", file=sys.stderr)
        return False
    for name, data in made.items():
        if name.startswith("file "):
            write_bytes(folder / name.removeprefix("file "), data.tobytes())
    how = " by the neo-Hookean law" if by_law else ""
    print(f"{folder}: {skin}: learned from {int(made['samples'])} samples of {int(made['movements'])} movements{how}")
    for kind, row in zip(KINDS, made["held_out"], strict=True):
        print(f"  {_quality(f'{kind}, {int(row[-1])} movements held out', row)}")
    if made["unsettled"]:
        print(f"  left out {int(made['unsettled'])} samples at which the law did not converge")
    return True


def _quality(what: str, row: NDArray[np.float64]) -> str:
    ridge, ridge_most, network, network_most, _ = row.tolist()
    return (
        f"{what.replace('_', ' ')}: polynomial {100 * ridge:.1f} % off "
        f"(nine in ten below {100 * ridge_most:.1f} %), network {100 * network:.1f} % ({100 * network_most:.1f} %)"
    )
