"""The kernels' own functions of numbers, against those of a C library."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from core.kernels import building

CODE = """
#include "kernels.h"
#include "numbers.h"
DERMIS_API void turn(double angle, double *sine, double *cosine);
DERMIS_API void turn(double angle, double *sine, double *cosine) { dermis_turn(angle, sine, cosine); }
"""


@pytest.mark.skipif(not shutil.which("gcc"), reason="THE KERNELS' NUMBERS ARE NOT TRIED: apt-get install gcc")
def test_sine_and_cosine_are_right_to_two_roundings(tmp_path: Path) -> None:
    """A rounding of the result is 1.1e-16 of a number near 1; small sines are as exact relative to themselves."""
    (tmp_path / "numbers.c").write_text(CODE)
    flags = (*building.FLAGS, "-fPIC", f"-I{building.FOLDER}")
    subprocess.run(["gcc", *flags, "-o", str(tmp_path / "a.so"), str(tmp_path / "numbers.c")], check=True)
    own, pair = ctypes.CDLL(str(tmp_path / "a.so")), (ctypes.c_double * 2)()
    own.turn.argtypes = ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p
    angles = np.concatenate([np.linspace(-np.pi / 2, np.pi / 2, 20001), np.geomspace(1e-300, 1.0, 601), [0.0]])
    found = []
    for angle in angles.tolist():
        own.turn(angle, ctypes.addressof(pair), ctypes.addressof(pair) + 8)
        found.append(tuple(pair))
    sine, cosine = np.array(found).T
    np.testing.assert_allclose(sine, np.sin(angles), rtol=2.0 * np.finfo(float).eps, atol=0.0)
    np.testing.assert_allclose(cosine, np.cos(angles), rtol=0.0, atol=2.0 * np.finfo(float).eps)
