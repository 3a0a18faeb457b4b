"""A finger's skin of the tissue that it wants: linear, or one that stiffens where the table of its shape is at hand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..cache import Cache
from ..errors import DermisError
from ..parameters.error_bands import LINEAR, NEO_HOOKEAN, NEO_HOOKEAN_EXACT
from ..parameters.skin import SKIN_CONTACT
from ..skin.model import SkinModel, skin_from_parameters
from ..skin.stiff_tables import no_exact, no_stiffening


def finger_skin(
    parameters: Mapping[str, Any],
    preset: Mapping[str, Any],
    *,
    level: str = "",
    cache: Cache | None = None,
    where: str = "finger",
) -> SkinModel:
    """Return the skin that a finger of a scene has.

    Tissue that is to stiffen is linear where no table of its shape has been made yet: its contact says so.

    Args:
        parameters: of the finger: 'skin', 'skin_level', 'tissue'. preset: its skin where it has none, in SI.
        level: in place of the finger's own. cache: of skins and tables. where: for errors.

    Raises:
        DermisError: an unknown level, tissue or parameter of the skin, or a skin that cannot be made.
    """
    level = level or str(SKIN_CONTACT["skin_level"].of(parameters, where))
    tissue = str(SKIN_CONTACT["tissue"].of(parameters, where))
    made = skin_from_parameters(parameters.get("skin") or preset, level=level, cache=cache, where=f"{where}, skin")
    return of_tissue(made, tissue)


def of_tissue(skin: SkinModel, tissue: str) -> SkinModel:
    """Return the same skin of a tissue: 'linear', or one that stiffens where the table of its shape is at hand.

    Fingers of one shape share the table. It ships for the presets' lengths, and is looked for in the skin's cache for
    others; a mesh of one's own has none. Without the exact law's table tissue stiffens by the series.
    """
    if tissue == skin.tissue:
        return skin
    if tissue == LINEAR:
        return skin.with_stiffening(None)
    if skin.stiffening is not None and tissue == NEO_HOOKEAN:
        return skin.matched
    from .sampled_store import exactly_stiffened  # with what makes such tables, which linear skin has no use for
    from .stiffening_store import stiffened

    try:
        return (exactly_stiffened(skin) if tissue == NEO_HOOKEAN_EXACT else None) or stiffened(skin) or skin
    except DermisError:  # nobody can make its table: what is solved with it says so
        return skin


def asked_for(skin: SkinModel, tissue: str, where: str) -> SkinModel:
    """Return the same skin of the tissue that somebody asked for by name.

    Raises:
        DermisError: an unknown tissue; code 'tissue-linear': there is no table of how the skin stiffens.
    """
    SKIN_CONTACT["tissue"].check(tissue, where)
    made = of_tissue(skin, tissue)
    if made.tissue != tissue:
        why = no_stiffening(skin.shape, where) if made.tissue == LINEAR else no_exact(where)
        raise DermisError(
            "there is no table of how its tissue stiffens" if made.tissue == LINEAR else "its exact law has no table",
            where=where,
            value=why.value,
            remedy=why.remedy,
            code=why.code,
        )
    return made
