"""What a machine can hold of the prose: README's size, the names of buttons, and how often noun clauses occur."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

pytestmark = pytest.mark.one_line("3.13", "the text of the sources is read")

ROOT = Path(__file__).resolve().parents[2]
CODE = re.compile(r"```.*?```", re.DOTALL)
# A clause that begins with 'what' and stands for a noun: 'of what presses', 'what that comes to'.
CLAUSE = re.compile(
    r"\bwhat (?:is|was|it|they|a|the|has|lies|presses|touches|slips|sticks|stands|comes|goes|came|went|moves|can|"
    r"cannot|may|else|there|nothing|makes|deforms|happens|some|shall|each|all|one|friction|tissue|skin)\b",
    re.IGNORECASE,
)
# The most a kind of text may have, for each 10,000 words. The aim is 10 everywhere: lower a number with the text.
MOST = {"core": 10.0, "blender_addon": 2.0, "pages": 8.0}
ITALIC = re.compile(r"(?<![*\w])\*([A-Z][^*\n]*?)\*(?![*\w])")
# Buttons, menus and keys of Blender itself, and two words that stand in italics for other reasons.
BLENDERS = {
    *("Add", "Edit", "Esc", "File", "Get Extensions", "Import", "Install from Disk", "N", "Preferences", "Shift Esc"),
    *("Adjust Last Operation", "HapTip", "Recorded Poses"),
}


def test_readme_is_short() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 120
    assert words_of(CODE.sub(" ", text)) <= 1000


def test_readmes_figures_are_those_of_the_results() -> None:
    rows = re.findall(
        r"^\| (`\w+`) \|.*?\| ([\d.]+(?: \w+)?) \|", (ROOT / "README.md").read_text(encoding="utf-8"), re.M
    )
    assert len(rows) == 6
    results = (ROOT / "tests" / "benchmarks" / "RESULTS.md").read_text(encoding="utf-8")
    for name, figure in rows:
        (row,) = re.findall(rf"^\| {name} \|.*$", results, re.M)
        assert f"| {figure} |" in row, f"{name}: {figure} in README, in the results {row}"


@pytest.mark.parametrize("kind", MOST)
def test_noun_clauses_are_few(kind: str) -> None:
    words = clauses = 0
    for text in texts(kind):
        words += words_of(text)
        clauses += len(CLAUSE.findall(text))
    assert words > 10_000
    assert 1e4 * clauses / words <= MOST[kind]


@pytest.mark.parametrize("page", ["README.md", "blender_addon/GUIDE.md"])
def test_buttons_that_a_page_names_are_there(page: str) -> None:
    """Paragraphs of papers' titles are left out."""
    folders = (ROOT / "blender_addon").rglob("*.py"), (ROOT / "core" / "parameters").glob("*.py")
    labels = {re.sub(r"^\d\.\s+", "", text.strip()) for folder in folders for path in folder for text in strings(path)}
    text = CODE.sub(" ", (ROOT / page).read_text(encoding="utf-8"))
    text = re.sub(r"^Papers: .*?(?:\n\n|\Z)", "", text, flags=re.M | re.S)
    named = {part for phrase in ITALIC.findall(text) for part in phrase.split(" > ")}
    assert len(named) > 8 and named - labels - BLENDERS == set()


def texts(kind: str) -> list[str]:
    """Return docstrings and comments of a folder, or all pages without their code."""
    if kind == "pages":
        apart = {".git", ".venv", "node_modules"}
        found = (p for p in sorted(ROOT.rglob("*.md")) if p.relative_to(ROOT).parts[0] not in apart)
        return [CODE.sub(" ", path.read_text(encoding="utf-8")) for path in found]
    return [prose(path.read_text(encoding="utf-8")) for path in sorted((ROOT / kind).rglob("*.py"))]


def prose(source: str) -> str:
    """Return the docstrings and comments of a module."""
    defined = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    parts = [ast.get_docstring(n) or "" for n in ast.walk(ast.parse(source)) if isinstance(n, defined)]
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return "\n".join(parts + [t.string.lstrip("# ") for t in tokens if t.type == tokenize.COMMENT])


def strings(path: Path) -> list[str]:
    """Return the texts of a module."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    return [n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)]


def words_of(text: str) -> int:
    return len(re.findall(r"[A-Za-z']+", text))
