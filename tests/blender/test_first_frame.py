"""The first frames of every demo: no handler, timer or draw callback holds the window, whatever is read or made.

Judged is the processor's time of the window's thread against a peer in the same process: how long Blender takes to
enable its own add-on node_wrangler. `first_frame_block_ms` is the time on the wall, each demo in a profile of its own.
Here they share one: what a first demo lets child processes make is read by others. Other processes still cost time:
they empty the processor's caches. So a run above the limit is repeated at most twice, each time in a new profile, and
the least of the runs is judged.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.benchmarks.bench_first_frame import DEMOS, run

# Times the peer that one call may take: twice 50 ms where `register_ms` was measured, whose peer node_wrangler took
# 16.9 ms. Twice, because one peer tells a processor's speed at other work only roughly: the heaviest solve of a demo
# takes 2 to 3.6 times the peer, from one machine and Python to another. `first_frame_block_ms` holds the 50 ms.
MOST = 2.0 * 50.0 / 16.9
TRIES = 3  # runs of a demo, where the first ones are above the limit


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files of all demos."""
    made = tmp_path_factory.mktemp("demos")
    run(made, "made", *DEMOS)
    return made


@pytest.mark.one_line("3.13", "what takes long is read and solved in the same threads on both")
@pytest.mark.parametrize("demo", DEMOS)
def test_no_piece_of_work_holds_the_window(folder: Path, demo: str) -> None:
    tried: list[dict[str, Any]] = []
    while len(tried) < TRIES and not (tried and ratio(tried[-1]) <= MOST):
        tried.append(run(folder, "cold" if not tried else f"cold {len(tried)}", demo))
        assert tried[-1]["shown"], "something was shown in the end"
        assert all(read.endswith(" in _on_load") for read in tried[-1]["reads"]), "a window waits for no module"
    told = ", ".join(f"{found['busiest']}: {found['cpu']:.0f} ms, peer {found['peer']:.0f} ms" for found in tried)
    assert min(map(ratio, tried)) <= MOST, told


def ratio(found: dict[str, Any]) -> float:
    """Return the processor time of the longest call over that of the peer."""
    return found["cpu"] / found["peer"]
