"""Make references anew and print all of them: `python -m tests.benchmarks.references [FAMILY ...]`.

`... table` prints them without making any. A family takes one to three minutes of the processor; see `cases.py` for
their names.
"""

from __future__ import annotations

import sys

from .results import load, table

if sys.argv[1:] != ["table"]:
    from .making import make

    make(sys.argv[1:])
print(table(load()))
