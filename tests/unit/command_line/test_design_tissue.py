"""The design tools' command line says where a scene's tissue is taken for linear."""

import argparse
from types import SimpleNamespace

import pytest

from core.command_line.design import _linear


@pytest.mark.parametrize(("tissue", "told"), [("neo_hookean", 1), ("linear", 0), (None, 0)])
def test_tissue_that_stiffens_is_said_to_be_taken_for_linear(tissue, told) -> None:
    parameters = {} if tissue is None else {"tissue": tissue}
    scene = SimpleNamespace(fingers=[SimpleNamespace(parameters=parameters)])
    found = _linear(argparse.Namespace(finger=0), {"a.npz": scene})
    assert [f.code for f in found] == ["tissue-linear"] * told
    assert not _linear(argparse.Namespace(finger=3), {"a.npz": scene})
