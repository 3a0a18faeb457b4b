"""Scripts and files of earlier releases go on: no published name is gone, and each old name and format has its test.

`old_names.json` has what releases published: public names as in `API.md`, verbs of the command line with their options,
ids of operators, and codes of findings. Nothing is taken out of it. A name that has to go becomes an alias, which is
put into `KEPT`, or gets a line in the changelog and is put into `GONE`.
"""

from __future__ import annotations

import argparse
import ast
import json
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import pytest

from core import parameters
from core.__main__ import main
from core.command_line.verbs import OLD_VERBS, parser
from core.parameters.parameter import Parameter

pytestmark = pytest.mark.one_line("3.11", "the text of the sources is read")

ROOT = Path(__file__).resolve().parents[2]
OLD = json.loads(Path(__file__).with_name("old_names.json").read_text(encoding="utf-8"))
# published name that is gone -> words about it in the changelog
GONE = {"Surface:planes": "`Surface.planes` and its rims are gone from the library"}


class Held(NamedTuple):
    """The test that holds what an old name means."""

    file: str  # below tests/
    function: str
    said: str  # how it calls the name


# Old names and formats that scripts and files may still have.
KEPT = {
    "property use_range": Held(
        "blender/test_touched_frames.py", "test_old_files_and_scripts_keep_their_meaning", '["use_range"] = 1'
    ),
    "property zero_is_hole": Held(
        "blender/test_screen_reliefs.py",
        "test_files_of_earlier_versions_keep_their_zeros_as_holes",
        "settings.zero_is_hole",
    ),
    "property dermis_finger_id": Held(
        "blender/test_identity.py", "test_calibrations_of_an_earlier_version_are_still_worn", "obj[identity.LEGACY]"
    ),
    "tissue neo_hookean_exact": Held(
        "unit/skin/test_finger_skin.py", "test_what_older_files_call_exact_follows_the_law", '"neo_hookean_exact"'
    ),
    "bake 1": Held("blender/test_stiff_skins.py", "test_results_of_the_first_version_are_read", "(pressing, 1,"),
    "bake 2": Held(
        "blender/test_stiff_skins.py",
        "test_a_bake_by_the_series_of_an_earlier_version_is_read_and_told_by_the_law",
        "(pressing, 2,",
    ),
    "dermis-calibration 1": Held(
        "unit/devices/test_calibration.py", "test_files_of_version_1_are_still_read", '"dermis-calibration 1"'
    ),
    "dermis-calibration 2": Held(
        "unit/devices/test_calibration.py", "test_files_of_version_1_are_still_read", '"calibration 2"'
    ),
    "dermis-calibration 3": Held(
        "unit/stream/test_measured_curves.py",
        "test_connect_tells_what_was_measured_and_live_movement_stays",
        '"dermis-calibration 3"',
    ),
    "dermis-stream-log 1": Held(
        "unit/stream/log/test_files.py", "test_a_log_of_the_first_version_is_read", '"dermis-stream-log 1"'
    ),
    "dermis-surrogate 1": Held(  # it is refused, with the remedy
        "unit/surrogate/test_skin.py",
        "test_an_older_surrogate_is_refused_in_words_and_the_search_goes_on",
        '"dermis-surrogate 1"',
    ),
    "verb thimble follow": Held(
        "unit/test_old_names.py", "test_an_old_verb_works_and_names_the_new_one", "thimble follow"
    ),
}
WRITTEN_ONLY = {"dermis-acceptance"}  # reports for people, which nothing reads
NO_ALIASES = {"skin_level reference"}  # a value that no menu offers, and no old name of another


def sources(*folders: str) -> Iterator[str]:
    """Return the text of every source file of the engine or the add-on."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.read_text(encoding="utf-8")


def found_aliases() -> set[str]:
    """Return old names and formats that the sources know."""
    found = {f"verb {' '.join(old)}" for old in OLD_VERBS}
    for text in sources("blender_addon"):
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.AnnAssign) and re.search(
                r"[Oo]ld name|earlier version|older version", ast.unparse(node)
            ):
                found.add(f"property {ast.unparse(node.target)}")
        found |= {f"property {name}" for name in re.findall(r'^LEGACY = "(\w+)"', text, re.M)}
        for versions in re.findall(r"^READ = \(([\d, ]+)\)", text, re.M):
            found |= {f"bake {version}" for version in versions.split(", ")[1:]}
    for text in sources("core", "blender_addon"):
        for name, number in re.findall(r'^[A-Z_]+ = "(dermis-[a-z-]+) (\d+)"', text, re.M):
            if name not in WRITTEN_ONLY:
                found |= {f"{name} {older}" for older in range(1, int(number))}
    for row in rows():
        found |= {f"{row.name} {value}" for value in row.besides} - NO_ALIASES
    return found


def rows() -> Iterator[Parameter]:
    """Return every parameter of scenes and presets."""
    for file in sorted(Path(parameters.__path__[0]).glob("[a-z]*.py")):
        for table in vars(import_module(f"core.parameters.{file.stem}")).values():
            if isinstance(table, MappingProxyType):
                yield from (row for row in table.values() if isinstance(row, Parameter))


def published(page: str) -> set[str]:
    """Return the public names of an API page: `Name`, `Name:attribute`, `Name.call()` and `Name.call(argument)`."""
    names = set()
    for part in re.split(r"^### ", page, flags=re.M)[1:]:
        own = part.split("\n", 1)[0].strip()
        names.add(own)
        for code in re.findall(r"```python\n(.*?)```", part, re.S):
            call = re.match(r"(?:class |def )?\.?(?:\w+\.)?(\w+)\((.*)\)", " ".join(code.split()))
            if ">>>" in code or call is None:
                continue
            inner, before = call[2], ""
            while inner != before:
                before, inner = inner, re.sub(r"\[[^\[\]]*\]|\([^()]*\)", "", inner)
            given = (words.strip(" *").split(":")[0].split("=")[0].strip() for words in inner.split(","))
            names |= {f"{own}.{call[1]}()", *(f"{own}.{call[1]}({name})" for name in given if name.isidentifier())}
        for said in re.findall(r"^\* `?\.?([a-z_, ]+)`?: ", part, re.M):
            names |= {f"{own}:{name.strip()}" for name in said.split(",") if name.strip().isidentifier()}
    return names


def verbs(command: argparse.ArgumentParser, name: str = "") -> dict[str, set[str]]:
    """Return the verbs of a command line with their options."""
    within = [a for a in command._actions if isinstance(a, argparse._SubParsersAction)]
    if not within:
        return {name: {option for action in command._actions for option in action.option_strings}}
    found: dict[str, set[str]] = {}
    for action in within:
        for verb, own in action.choices.items():
            found |= verbs(own, f"{name} {verb}".strip())
    return found


@cache
def functions(file: Path) -> dict[str, str]:
    """Return the functions of a file, with their text; fixtures and cases of a test stand in its decorators."""
    text = file.read_text(encoding="utf-8")
    found = {}
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef):
            first = min([node.lineno, *(part.lineno for part in node.decorator_list)])
            found[node.name] = "\n".join(text.splitlines()[first - 1 : node.end_lineno])
    return found


def words(release: str, kind: str) -> list[str]:
    return " ".join(OLD[release][kind]).split()


def gone(names: set[str]) -> set[str]:
    """Return those of some names that neither are kept nor stand in the changelog."""
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    return {name for name in names if name not in GONE or GONE[name] not in changelog}


@pytest.mark.parametrize("release", OLD)
def test_public_names_attributes_and_arguments_are_there(release: str) -> None:
    now = published((ROOT / "core" / "API.md").read_text(encoding="utf-8"))  # a test holds the page to the engine
    assert len(now) > 450 and not gone(set(words(release, "public")) - now)


@pytest.mark.parametrize("release", OLD)
def test_verbs_and_their_options_are_there(release: str) -> None:
    now = verbs(parser("dermis"))
    for old, options in OLD[release]["verbs"].items():
        new = OLD_VERBS.get(tuple(old.split()))
        verb = old if new is None else new[0]
        assert verb in now, f"{old} is gone"
        assert not gone({f"{old} {option}" for option in set(options.split()) - now[verb]})


@pytest.mark.parametrize("release", OLD)
def test_operators_are_there(release: str) -> None:
    now = {name for text in sources("blender_addon") for name in re.findall(r'bl_idname = "(dermis\.\w+)"', text)}
    assert not gone(set(words(release, "operators")) - now)


@pytest.mark.parametrize("release", OLD)
def test_codes_of_findings_are_there(release: str) -> None:
    now = {code for text in sources("core", "blender_addon") for code in re.findall(r'"([a-z][a-z0-9-]*)"', text)}
    assert not gone(set(words(release, "findings")) - now)


def test_every_alias_has_a_test() -> None:
    assert found_aliases() == set(KEPT)


@pytest.mark.parametrize("old", KEPT)
def test_the_test_of_an_alias_is_there(old: str) -> None:
    file, function, said = KEPT[old]
    assert said in functions(ROOT / "tests" / file)[function], f"{function} does not name it"


def test_an_old_value_is_taken() -> None:
    found = [(row, value) for row in rows() for value in row.besides if f"{row.name} {value}" in KEPT]
    assert found
    for row, value in found:
        assert row.of({row.name: value}) == value


@pytest.mark.parametrize("old", OLD_VERBS, ids=" ".join)
def test_an_old_verb_works_and_names_the_new_one(
    old: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """'thimble follow' is refused for its recording, as the new verb is, and not for its name."""
    said: dict[str, Any] = {}
    for name, verb in (("old", old), ("new", OLD_VERBS[old])):
        assert main([*verb, str(tmp_path / "none.csv"), "--out", str(tmp_path / "track.csv")]) == 2
        said[name] = capsys.readouterr().err
    first, _, rest = said["old"].partition("\n")
    assert first == f"'{' '.join(old)}' is '{' '.join(OLD_VERBS[old])}' now" and rest == said["new"]
    assert "none.csv" in rest
