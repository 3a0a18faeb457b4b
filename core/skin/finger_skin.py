"""Skin of a finger with linear or neo-Hookean tissue, from its parameters."""

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
    """Return the skin of a finger of a scene.

    Args:
        parameters: parameters of the finger: 'skin', 'skin_level', 'tissue'.
        preset: parameters of the skin in SI units, for a finger that has none of its own.
        level: resolution of the mesh; '' for the level in `parameters`.
        cache: cache of skins and tables.
        where: name of the finger, for errors.

    Raises:
        DermisError: the level, the tissue or a parameter of the skin is unknown, or the skin cannot be computed.
    """
    level = level or str(SKIN_CONTACT["skin_level"].of(parameters, where))
    tissue = str(SKIN_CONTACT["tissue"].of(parameters, where))
    made = skin_from_parameters(parameters.get("skin") or preset, level=level, cache=cache, where=f"{where}, skin")
    return of_tissue(made, tissue)


def of_tissue(skin: SkinModel, tissue: str) -> SkinModel:
    """Return the same skin with the tissue 'linear' or 'neo_hookean'."""
    return skin.linear if tissue == LINEAR else skin.with_law()


def asked_for(skin: SkinModel, tissue: str, where: str) -> SkinModel:
    """Return the same skin with another tissue, after a check of the name.

    Args:
        skin: the skin.
        tissue: name of the tissue, see `of_tissue`.
        where: name of the skin, for errors.

    Raises:
        DermisError: the tissue is unknown.
    """
    SKIN_CONTACT["tissue"].check(tissue, where)
    return of_tissue(skin, tissue)
