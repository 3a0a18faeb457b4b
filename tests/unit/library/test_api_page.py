"""The pages that `build_addon.py docs` writes are current: public interface, parameters and command line."""

from __future__ import annotations

import re
from pathlib import Path

import build_addon
import core

from .conftest import ROOT

PAGE = ROOT / "core" / "API.md"


def test_the_pages_are_current(tmp_path: Path) -> None:
    assert build_addon.main(["docs", "--out", str(tmp_path)]) == 0
    for name in build_addon.DOCS:
        made, kept = ((folder / name).read_text(encoding="utf-8") for folder in (tmp_path, PAGE.parent))
        assert made == kept, "write it anew: python3 build_addon.py docs"


def test_every_public_name_has_its_place_and_its_link() -> None:
    text = PAGE.read_text(encoding="utf-8")
    headings = re.findall(r"^### (\w+)$", text, re.M)
    assert sorted(headings) == sorted(core.__all__)
    anchors: list[str] = []
    for name in headings:
        again = sum(a.split("-")[0] == name.lower() for a in anchors)
        anchors.append(name.lower() + (f"-{again}" if again else ""))
    assert re.findall(r"\]\(#([\w-]+)\)", text) == anchors
    assert text.count("```") % 2 == 0
    for said in (
        "DermisError: a number is out of range",
        "`.von_mises`: Von Mises stress of each element [Pa]",
        "`.resultant`: Sum of the forces on the skin [N]",  # of a base class
        "Surface.sphere(radius: float",
    ):
        assert said in text
