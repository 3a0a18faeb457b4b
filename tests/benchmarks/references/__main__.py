"""Print the references, or make what is missing: `python -m tests.benchmarks.references [make [FAMILY ...]]`."""

from __future__ import annotations

import sys

from .results import load, table

if sys.argv[1:2] == ["make"]:
    from .making import make

    make(sys.argv[2:])
print(table(load()))
