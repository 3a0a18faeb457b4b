"""The pipe from the process that started this one: its end tells that whoever held it is gone."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable


def when_input_ends(do: Callable[[], object]) -> None:
    """Do something once standard input has ended: the parent closed it, or is dead."""

    def read() -> None:
        while sys.stdin.buffer.read(4096):
            pass
        do()

    threading.Thread(target=read, daemon=True).start()
