"""A table collected by workers on skin that stiffens: as in one process, and in a folder of its own."""

import numpy as np

from core.design.collect import collect
from core.matching.readings import readings_of
from core.matching.table import build
from core.presets import Library
from core.skin.shape import FingertipShape
from core.steps import drain
from tests.stiff_skins import stiff_skin

ROWS = 64


def test_workers_press_the_tissue_that_they_are_told(tmp_path) -> None:
    skin, spec = stiff_skin(), Library().device("hexapod")
    whole = build(spec, skin, readings_of(skin), ROWS)
    table = drain(collect(spec, FingertipShape(), tmp_path, rows=ROWS, stiffening=skin.stiffening))
    np.testing.assert_allclose(table.commands, whole.commands, atol=1e-7)
    np.testing.assert_array_equal(table.readings, whole.readings)
    linear = drain(collect(spec, FingertipShape(), tmp_path, rows=ROWS))
    assert len(list(tmp_path.iterdir())) == 2
    both = min(len(linear.readings), len(whole.readings))
    assert np.abs(linear.readings[:both].astype(float) - whole.readings[:both]).max() > 10.0
