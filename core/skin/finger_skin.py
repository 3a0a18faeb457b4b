"""A finger's skin of the tissue that it wants: linear, or one that follows the neo-Hookean law."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..cache import Cache
from ..parameters.error_bands import LINEAR
from ..parameters.skin import SKIN_CONTACT
from .model import SkinModel, skin_from_parameters


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
    """Return the same skin of a tissue: 'linear', or 'neo_hookean', which follows the law."""
    return skin.linear if tissue == LINEAR else skin.with_law()


def asked_for(skin: SkinModel, tissue: str, where: str) -> SkinModel:
    """Return the same skin of the tissue that somebody asked for by name.

    Raises:
        DermisError: an unknown tissue.
    """
    SKIN_CONTACT["tissue"].check(tissue, where)
    return of_tissue(skin, tissue)
