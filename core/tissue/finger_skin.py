"""A finger's skin of the tissue that it wants: linear, or one that follows the neo-Hookean law."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..cache import Cache
from ..errors import DermisError
from ..parameters.error_bands import LINEAR
from ..parameters.skin import SKIN_CONTACT
from ..skin.model import SkinModel, skin_from_parameters
from ..skin.stiff_tables import no_series


def finger_skin(
    parameters: Mapping[str, Any],
    preset: Mapping[str, Any],
    *,
    level: str = "",
    cache: Cache | None = None,
    where: str = "finger",
) -> SkinModel:
    """Return the skin that a finger of a scene has.

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
    """Return the same skin of a tissue: 'linear', or 'neo_hookean', which follows the law.

    What devices do is matched by a series of it, whose table fingers of one shape share. It ships for the presets'
    lengths, and is looked for in the skin's cache for others; without one, and on a mesh of one's own, devices are
    matched on linear skin.
    """
    if tissue == LINEAR:
        return skin if skin.tissue == LINEAR else skin.with_stiffening(None)
    if skin.follows_law and skin.stiffening is not None:
        return skin
    from .stiffening_store import find_series  # with what makes such tables, which linear skin has no use for

    found = find_series(skin)
    return skin if skin.follows_law and found is None else skin.with_law(found)


def asked_for(skin: SkinModel, tissue: str, where: str) -> SkinModel:
    """Return the same skin of the tissue that somebody asked for by name.

    Raises:
        DermisError: an unknown tissue.
    """
    SKIN_CONTACT["tissue"].check(tissue, where)
    return of_tissue(skin, tissue)


def for_devices(skin: SkinModel, tissue: str, where: str) -> SkinModel:
    """Return the same skin as devices are matched with it, of the tissue that somebody asked for by name.

    Raises:
        DermisError: an unknown tissue; code 'matched-linear': there is no series of how it stiffens.
    """
    made = asked_for(skin, tissue, where).matched
    if tissue != LINEAR and made.tissue == LINEAR:
        why = no_series(skin.shape, where)
        raise DermisError(
            "there is no series of how its tissue stiffens",
            where=where,
            value=why.value,
            remedy=why.remedy,
            code=why.code,
        )
    return made
