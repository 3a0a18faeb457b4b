"""The weakest force of a shear tactor against the preset's figures and a search over directions."""

from __future__ import annotations

import numpy as np
import pytest

from core.__main__ import main
from core.devices.shear_tactor import ShearTactor
from core.errors import DermisError
from core.presets import Library
from core.studies.cap_force import cap_force, text

SPEC = Library().device("haptip")


def test_both_figures_of_the_paper_follow_from_one_torque_limit() -> None:
    found = cap_force(SPEC)
    assert found.reference == pytest.approx(3.4, abs=1e-3) == SPEC.parameters["force_reference"]
    assert found.anywhere == pytest.approx(3.4, abs=1e-3)
    assert found.reference_shared == pytest.approx(3.4, abs=1e-3)
    assert found.anywhere_shared == pytest.approx(SPEC.parameters["force_anywhere"], abs=2e-3)
    assert np.hypot(*found.place) == pytest.approx(2e-3)


def test_the_weakest_direction_is_that_of_virtual_work() -> None:
    """Torques from the work of a small step at the weakest place: no other direction asks for more."""
    found, tactor, step = cap_force(SPEC), ShearTactor.from_spec(SPEC), 1e-8
    place = (1.0 - 1e-6) * np.array(found.place)
    rate = np.array(
        [(tactor.inverse(place + step * e) - tactor.inverse(place - step * e)) / (2 * step) for e in np.eye(2)]
    )
    angle = np.linspace(0.0, np.pi, 3601)
    ways = np.column_stack([np.cos(angle), np.sin(angle)])
    size = np.hypot(*np.linalg.solve(rate, ways.T))  # torques of a unit force: J^T F, J the inverse of the rate
    assert tactor.torque / size.max() == pytest.approx(found.anywhere_shared, rel=1e-4)
    off = abs(angle[size.argmax()] - found.direction)
    assert min(off, np.pi - off) < 1e-2


def test_the_verb_prints_both_rules_and_others_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["weakest-force"]) == 0
    assert "2.65" in capsys.readouterr().out and "2.65" in text(cap_force(SPEC), SPEC)
    with pytest.raises(DermisError, match="not a shear tactor"):
        cap_force(Library().device("thimble_3rrs"))
