"""The exact law in a few fields against the exact neo-Hookean finger: `bench_nonlinear`'s touches, names and limits.

Touches that its table was made of have a seed and ranges of their own (`core/tissue/sampled_table_fit.py`); the forty
here are unseen. The series and linear skin stand beside it.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from . import Result, benchmark


@benchmark("nl_exact_stress_error_2mm", limit=0.075)
def stress_error_2mm() -> Result:
    """Stress 2 mm deep, all kinds of path."""
    return _error("nl_exact_stress_error_2mm", "stress", 2e-3)


@benchmark("nl_exact_stress_p90_2mm", limit=0.13)
def stress_p90_2mm() -> Result:
    """The 90th percentile of the same."""
    found = _error("nl_exact_stress_p90_2mm", "stress", 2e-3)
    return Result(found.name, float(found.p95 or np.nan), "1", None, found.peers, found.error)


@benchmark("nl_exact_force_error_2mm", limit=0.01)
def force_error_2mm() -> Result:
    """The sum of the forces 2 mm deep."""
    return _error("nl_exact_force_error_2mm", "force", 2e-3)


@benchmark("nl_exact_stress_error_1mm", limit=0.04)
def stress_error_1mm() -> Result:
    """Stress 1 mm deep."""
    return _error("nl_exact_stress_error_1mm", "stress", 1e-3)


@benchmark("nl_exact_stress_error_shear", limit=0.10)
def stress_error_shear() -> Result:
    """Stress where the object was then drawn 2 mm across the finger."""
    return _error("nl_exact_stress_error_shear", "stress", 2e-3, 2e-3)


@benchmark("nl_exact_stress_error_slide", limit=0.15)
def stress_error_slide() -> Result:
    """Stress where it was drawn 6 mm."""
    return _error("nl_exact_stress_error_slide", "stress", 2e-3, 6e-3)


@benchmark("nl_exact_stress_error_edge", limit=0.20)
def stress_error_edge() -> Result:
    """Stress under edges and ribs, 2 mm deep."""
    from .nonlinear_errors import EDGES

    return _error("nl_exact_stress_error_edge", "stress", 2e-3, kinds=EDGES)


@benchmark("nl_exact_worse_than_linear", limit=0.0)
def worse_than_linear() -> Result:
    """The share of all frames, to 4 mm deep and 6 mm slid, at which stress is farther off than linear skin's."""
    from core.parameters.error_bands import NEO_HOOKEAN_EXACT

    from .bench_nonlinear import worse

    return worse("nl_exact_worse_than_linear", NEO_HOOKEAN_EXACT)


@benchmark("nl_exact_frame_ratio", limit=10.0)
def frame_ratio() -> Result:
    """A frame on points over that of linear skin, as `nl_frame_ratio`; at nodes beside it."""
    from core.parameters.error_bands import NEO_HOOKEAN_EXACT

    from .bench_nonlinear import ratio

    (median, late), (at_nodes, late_nodes) = (ratio(points, NEO_HOOKEAN_EXACT) for points in (True, False))
    return Result("nl_exact_frame_ratio", median, "1", late, {"at nodes": at_nodes, "at nodes, p95": late_nodes})


@benchmark("nl_exact_table_mb", limit=10.0)
def table() -> Result:
    """The table of a finger, as a file."""
    from core.tissue.sampled_store import find_table
    from core.tissue.stiffening_store import SHIPPED

    from .nonlinear_errors import reference

    skin = reference().skin
    assert skin.shape is not None
    found = find_table(skin.shape, skin.material.poisson, shipped=SHIPPED)
    assert found is not None, "no exact table of the standard finger ships"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "table.npz"
        found.write(file)
        return Result("nl_exact_table_mb", file.stat().st_size / 1e6, "MB")


def _error(name: str, what: str, depth: float, slide: float = 0.0, kinds: tuple[str, ...] = ()) -> Result:
    from core.parameters.error_bands import LINEAR, NEO_HOOKEAN, NEO_HOOKEAN_EXACT

    from .bench_nonlinear import error

    return error(name, what, depth, slide, kinds, {"": NEO_HOOKEAN_EXACT, "series": NEO_HOOKEAN, "linear": LINEAR})
