"""The commands that pages and workflows show, and whether Dermis understands them."""

from __future__ import annotations

import re
import shlex

import build_addon
from core.command_line.verbs import parser

from .conftest import ROOT


def commands(text: str) -> list[list[str]]:
    """Return the commands of code blocks and of steps that run Dermis, without their comments."""
    lines = re.findall(r"^(?:\s*(?:-\s*)?run: )?\s*((?:python3? |\.ci/run).*)$", text, re.M)
    return [shlex.split(line, comments=True) for line in lines]


def understood(words: list[str]) -> None:
    """Let the parser of a command judge it."""
    if words[0] == ".ci/run":
        assert (ROOT / ".ci" / "run").is_file()
    elif words[1] == "build_addon.py":
        words = [w for w in words[2:] if not w.startswith("[") and w not in ("...]", "FILE]")]
        build_addon.parser().parse_known_args(words)
    elif words[1:3] in (["-m", "core"], ["-m", "dermis"]) and "--help" not in words:
        parser("core").parse_args([w.replace("PORT", "loop://").replace("FILE.csv", "a.csv") for w in words[3:]])
