"""Make references anew and print all of them: `python -m tests.benchmarks.references [FAMILY ...]`.

`... table` prints them without making any. Names are in `cases.py`. A family takes one to two minutes of a free core,
edges with friction seven.
"""

from __future__ import annotations

import sys

from .results import load, table

if sys.argv[1:] != ["table"]:
    from .making import make

    make(sys.argv[1:])
print(table(load()))
