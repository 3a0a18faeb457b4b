"""The pages that newcomers read name what is there: files, commands, links, and the two Pythons."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import build_addon

from .commands import commands, understood
from .conftest import ROOT, Installed

PAGES = [ROOT / "README.md", ROOT / "core" / "README.md", ROOT / ".github" / "CONTRIBUTING.md"]
PAGES += [ROOT / "blender_addon" / f"{name}.md" for name in ("GUIDE", "INSTALL", "PACKAGING")]
PAGES += [ROOT / "core" / f"{name}.md" for name in ("COMMANDS", "THEORY")]
PAGES += [ROOT / "presets" / f"{name}.md" for name in ("ACCURACY", "FORMATS", "README")]
PAGES += [ROOT / "tests" / "benchmarks" / "RESULTS.md", ROOT / "tests" / "examples" / "README.md"]
site_pages = build_addon.module_at(ROOT / ".ci" / "site_pages.py")


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
    written = {build_addon.zips.INDEX, build_addon.zips.NOTES}  # by `build_addon.py build`
    assert set(missing) <= {"demo_out/", "dist/", "surrogates/"} | written


def test_the_readmes_script_runs(library: Installed) -> None:
    (script,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.S)
    shown = zip(("touch", "pins"), re.findall(r"# ([.\w ]+)$", script, re.M), strict=True)
    attributes = "".join(f"print({name}{attribute})\n" for name, said in shown for attribute in said.split())
    assert library.run("-c", script + attributes).count("\n") >= 7


@pytest.mark.parametrize(
    "page",
    [*(p for p in PAGES if p.name != "COMMANDS.md"), ROOT / "core" / "API.md"],
    ids=lambda p: p.relative_to(ROOT).as_posix(),
)
def test_every_command_that_a_page_shows_is_understood(page: Path) -> None:
    for words in commands(page.read_text(encoding="utf-8")):
        understood(words)


def test_the_changelog_is_dated_and_has_a_place_for_what_is_next() -> None:
    headings = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    assert headings[0] == "Unreleased"
    assert all(re.fullmatch(r"\d+\.\d+\.\d+, \d{4}-\d{2}-\d{2}", heading) for heading in headings[1:])
    # The manifest has the version of the newest part, or, once it was raised, that of what is not released yet.
    newest, stated = numbers(headings[1]), numbers(build_addon.zips.manifest_value("version"))
    assert stated >= newest == max(map(numbers, headings[1:]))


def test_what_is_not_released_is_told_in_groups_and_lines() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    part = re.search(r"^## Unreleased\n(.*?)^## ", text, re.M | re.S)
    assert part is not None
    groups = re.findall(r"^### (.+)$", part[1], re.M)
    assert len(set(groups)) == len(groups) and set(groups) <= {"Added", "Changed", "Fixed", "Removed"}
    assert all(line.startswith(("* ", "### ")) for line in part[1].splitlines() if line)


def numbers(text: str) -> tuple[int, ...]:
    """Return the numbers of a version at the beginning of a text."""
    return tuple(map(int, text.partition(",")[0].split(".")))


def test_the_citation_is_of_this_version_and_licence() -> None:
    """GitHub shows it; its own keys are strings on lines of their own, so no reader of YAML is needed."""
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    stated = dict(re.findall(r"^([\w-]+): (.+)$", text, re.M))
    assert {"cff-version", "message", "title", "authors"} <= {*stated, *re.findall(r"^([\w-]+):$", text, re.M)}
    assert stated["version"] == build_addon.zips.manifest_value("version")
    assert build_addon.zips.manifest_value("maintainer") in text
    assert f'license = "{stated["license"]}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", ["README.md", "blender_addon/INSTALL.md", "blender_addon/PACKAGING.md"])
def test_pages_say_where_the_zips_have_not_run(page: str) -> None:
    """Until the hosts' workflows have: then their tables, this test and the words go together."""
    text = (ROOT / page).read_text(encoding="utf-8")
    assert re.search(r"Windows.{0,120}macOS", text, re.S)
    assert re.search(r"written, not run|not been run there", text, re.I)


@pytest.mark.parametrize("page", site_pages.pages(), ids=lambda p: p.relative_to(ROOT).as_posix())
def test_no_link_of_a_page_is_broken(page: Path) -> None:
    assert site_pages.broken(page) == []


def test_a_broken_link_is_found(tmp_path: Path) -> None:
    (tmp_path / "other.md").write_text("# Once\n\n# Once\n")
    page = tmp_path / "page.md"
    page.write_text("# A page: of [`code`](other.md)\n[a](other.md#once-1) [b](#a-page-of-code) `[x](no.md)`\n")
    assert site_pages.broken(page) == []
    page.write_text("[a](other.md#once-2) [b](#none) [c](no.md) [d](https://none.example)\n")
    assert site_pages.broken(page) == ["other.md#once-2", "#none", "no.md"]


@pytest.mark.one_line("3.13", "pages of text")
def test_the_site_builds_without_a_warning(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    try:
        status = build_addon.site(build_addon.environment(), tmp_path)
    except build_addon.Stop as problem:
        pytest.skip(f"MkDocs cannot be brought: {problem}")
    assert status == 0, capfd.readouterr().out
    found = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "hand.webp" in found and (tmp_path / "presets" / "pictures" / "hand.webp").is_file()
    assert "finger" in (tmp_path / "search" / "search_index.json").read_text(encoding="utf-8")
    assert (tmp_path / "presets" / "streaming_safety" / "index.html").is_file()
