"""The pages that newcomers read name what is there: files, commands, links, and the two Pythons."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

import build_addon
from core.command_line.verbs import parser

from .conftest import ROOT, Installed

PAGES = [ROOT / "README.md", ROOT / "core" / "README.md", ROOT / ".github" / "CONTRIBUTING.md"]
WORKFLOW = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_every_file_and_folder_that_a_page_names_is_there(page: Path) -> None:
    """In backticks: from the root, inside core or the add-on; capitals stand for any name. In links: from the page."""
    text = page.read_text(encoding="utf-8")
    missing = []
    for name in re.findall(r"`([\w./-]+(?:/|\.(?:py|md|toml|json|yml|txt)))`", text):
        if re.search(r"\b[A-Z]{4,}\b(?!\.md)", name):
            continue
        if not any((base / name).exists() for base in (ROOT, ROOT / "core", ROOT / "blender_addon", page.parent)):
            missing.append(name)
    for link in re.findall(r"\]\(([^)#:]+)(?:#[\w-]*)?\)", text):
        if not (page.parent / link).exists():
            missing.append(link)
    assert set(missing) <= {"demo_out/", "dist/", "surrogates/"}


def test_the_readmes_script_runs(library: Installed) -> None:
    (script,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.S)
    shown = zip(("touch", "pins"), re.findall(r"# ([.\w ]+)$", script, re.M), strict=True)
    attributes = "".join(f"print({name}{attribute})\n" for name, said in shown for attribute in said.split())
    assert library.run("-c", script + attributes).count("\n") >= 7


def commands(text: str) -> list[list[str]]:
    """Return the commands of code blocks and of steps that run Dermis, without their comments."""
    lines = re.findall(r"^(?:\s*(?:-\s*)?run: )?\s*((?:python3? |\.ci/run).*)$", text, re.M)
    return [shlex.split(line, comments=True) for line in lines]


@pytest.mark.parametrize("page", [*PAGES, ROOT / "core" / "API.md"], ids=lambda p: p.relative_to(ROOT).as_posix())
def test_every_command_that_a_page_shows_is_understood(page: Path) -> None:
    for words in commands(page.read_text(encoding="utf-8")):
        understood(words)


def understood(words: list[str]) -> None:
    """Let the parser of a command judge it."""
    if words[0] == ".ci/run":
        assert (ROOT / ".ci" / "run").is_file()
    elif words[1] == "build_addon.py":
        words = [w for w in words[2:] if not w.startswith("[") and w not in ("...]", "FILE]")]
        build_addon.parser().parse_known_args(words)
    elif words[1:3] in (["-m", "core"], ["-m", "dermis"]) and "--help" not in words:
        parser("core").parse_args([w.replace("PORT", "loop://").replace("FILE.csv", "a.csv") for w in words[3:]])


def test_the_hosts_workflow_runs_what_there_is() -> None:
    found = commands(WORKFLOW)
    assert [".ci/run"] in found and ["python", "build_addon.py", "test"] in found
    for words in found:
        understood(words)
    for line in {f"{a}.{b}" for a, b in build_addon.BLENDER}:
        assert WORKFLOW.count(f'"{line}"') == 1 and re.search(rf"^ +{re.escape(line)}$", WORKFLOW, re.M), line
    run = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    firmware = re.search(r"firmware_packages=\(([^)]*)\)", run)
    assert firmware
    for package in [*firmware[1].split(), *" ".join(build_addon.NEEDED_LIBRARIES.values()).split()]:
        assert re.search(rf"(?<![\w-]){re.escape(package)}(?![\w-])", WORKFLOW), f"{package} is not installed"


def test_the_changelog_is_dated_and_has_a_place_for_what_is_next() -> None:
    headings = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    assert headings[0] == "Unreleased"
    assert all(re.fullmatch(r"\d+\.\d+\.\d+, \d{4}-\d{2}-\d{2}", heading) for heading in headings[1:])
    assert any(heading.startswith(build_addon.manifest_value("version") + ",") for heading in headings)
