"""Compute the trust bands of a scene.

The scene is sampled once, and rendered with its variants.
"""

from __future__ import annotations

import bpy

from .._core import DermisError, core
from ..devices import skin_models
from ..film import film_objects
from ..jobs import Steps
from ..preferences import library
from ..results import same_inputs, store, trusted
from . import compared


def find(scene: bpy.types.Scene) -> Steps:
    """Sample a scene, and render it and its variants; yield progress.

    The result is kept and returned.

    Raises:
        DermisError: the scene cannot be sampled or rendered, or there is no track and no skin to judge.
    """
    yield core.pipeline.bake.Progress("preparing", 0, 1)
    taken = store.Taken.of(scene, (yield from same_inputs.reading(scene)))
    with film_objects.paused(scene):
        tactile = yield from compared.sampled(scene)
    yield from skin_models.make_tables(tactile, library())
    steps = core.comparison.trust_band.trust_bands(tactile, library(), cache=skin_models.cache())
    while True:
        try:
            with skin_models.one_thread():
                step = next(steps)
        except StopIteration as done:
            bands = done.value[1]
            break
        yield step
    if not bands:
        raise DermisError(
            "there is no track and no skin to judge",
            where=f"scene '{scene.name_full}'",
            remedy="Look at the findings of the bake, correct the scene, and bake again",
        )
    return trusted.keep(scene, bands, taken)
