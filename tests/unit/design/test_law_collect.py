"""A table collected by workers on skin that follows the neo-Hookean law: as in one process, in a folder of its own."""

import numpy as np
import pytest

from core.design.collect import collect
from core.matching.readings import readings_of
from core.matching.table import build
from core.presets import Library
from core.skin.model import fingertip_skin
from core.skin.shape import FingertipShape
from core.steps import drain

ROWS = 64


@pytest.mark.one_line("3.11", "numbers alone; test_collect.py has workers on both lines")
def test_workers_press_the_tissue_that_they_are_told(tmp_path) -> None:
    skin, spec = fingertip_skin(level="draft").with_law(), Library().device("hexapod")
    whole = build(spec, skin, readings_of(skin), ROWS)
    table = drain(collect(spec, FingertipShape(), tmp_path, rows=ROWS, tissue="neo_hookean"))
    np.testing.assert_allclose(table.commands, whole.commands, atol=1e-7)
    np.testing.assert_array_equal(table.readings, whole.readings)
    assert table.meta["law_unsettled_rows"] == whole.meta["law_unsettled_rows"]
    drain(collect(spec, FingertipShape(), tmp_path, rows=ROWS))
    assert len(list(tmp_path.iterdir())) == 2
