"""Pages 'paper against ours' have a section about neo-Hookean tissue, which is renewed without the rest of the page."""

from __future__ import annotations

from pathlib import Path

import pytest

from core.errors import DermisError
from tests.benchmarks.two_tissues import HEADING, renew

DEVICES = Path(__file__).parents[2] / "presets" / "devices"
MADE = {
    "thimble_3rrs_figures.md": "python -m tests.benchmarks.figures_s0 --law",
    "pin_array_128_figures.md": "python -m tests.benchmarks.figures_s1 --law",
    "motors_figures.md": "python -m tests.benchmarks.figures_s2 --law",
}


def test_a_section_is_renewed_and_all_else_stays(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"# Title\n\n## A\na\n\n{HEADING}\nold\n### Part\nold\n\n## B\nb\n")
    renew(page, f"{HEADING}\nnew\n\n")
    assert page.read_text() == f"# Title\n\n## A\na\n\n{HEADING}\nnew\n\n## B\nb\n"
    page.write_text(f"# Title\n{HEADING}\nold\n")
    renew(page, f"{HEADING}\nlast\n")
    assert page.read_text() == f"# Title\n{HEADING}\nlast\n"


def test_a_page_without_the_section_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Title\n\n## A\na\n")
    with pytest.raises(DermisError, match="Make the whole page once"):
        renew(page, f"{HEADING}\nnew\n")
    assert page.read_text() == "# Title\n\n## A\na\n"


@pytest.mark.parametrize("name", MADE)
def test_each_page_says_how_its_section_is_made_and_sets_both_tissues_side_by_side(name: str) -> None:
    text = (DEVICES / name).read_text()
    assert text.count(f"\n{HEADING}\n") == 1
    section = text.split(f"\n{HEADING}\n")[1].split("\n## ")[0]
    assert MADE[name] in section and "imulated" in section and "inear" in section
