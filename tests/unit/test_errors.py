"""Refusals keep their parts and their code, whatever they are turned into."""

from __future__ import annotations

import ast
import json
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

from core.errors import DermisError, Finding

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def error() -> DermisError:
    return DermisError("too thick", where="disc", value=np.int64(3), limit="1 mm", remedy="File it", code="too-thick")


def test_a_code_stands_beside_the_words_and_not_in_them(error: DermisError) -> None:
    assert str(error) == "disc: too thick (found 3; allowed: 1 mm). File it."
    assert error.code == "too-thick" and DermisError("no").code == "refused"


def test_what_is_not_replaced_stays(error: DermisError) -> None:
    other = error.changed(where="finger 'Index'", value=None)
    assert (other.code, str(other)) == ("too-thick", "finger 'Index': too thick (allowed: 1 mm). File it.")
    assert error.where == "disc"


def test_a_refusal_becomes_a_finding(error: DermisError) -> None:
    assert error.as_finding() == Finding("error", "too-thick", "too thick", "disc", 3, "1 mm", "File it")
    left_out = error.as_finding("warning", code="left-out", frame=4.0)
    assert (left_out.severity, left_out.code, left_out.frame) == ("warning", "left-out", 4.0)
    assert left_out.remedy == "File it"


def test_a_refusal_goes_through_json(error: DermisError) -> None:
    again = DermisError(**json.loads(json.dumps(error.as_dict())))
    assert (str(again), again.code) == (str(error).replace("found 3", "found '3'"), "too-thick")


def test_a_refusal_goes_through_a_pickle(error: DermisError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is DermisError and str(again) == str(error) and again.as_dict() == error.as_dict()


@pytest.mark.one_line("3.13", "the text of the sources is read")
def test_codes_are_short_words_with_hyphens() -> None:
    found = set()
    for folder in ("core", "blender_addon"):
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.keyword) and node.arg == "code" and isinstance(node.value, ast.Constant):
                    found.add(node.value.value)
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Finding":
                    found |= {code.value for code in node.args[1:2] if isinstance(code, ast.Constant)}
    assert {"no-finger", "not-json", "job-crashed", "servo-limit", "pins-not-converged"} <= found
    assert all(re.fullmatch(r"[a-z]+(-[a-z]+)*", code) for code in found if isinstance(code, str))
