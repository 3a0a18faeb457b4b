"""`python -m core work`: jobs for a parent process."""

from __future__ import annotations

import argparse

from ..work.processes import serve


def run(_options: argparse.Namespace) -> int:
    """Take jobs from standard input."""
    return serve()
