"""Surrogate: everything learned for one skin and device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..errors import DermisError
from ..skin.model import SkinModel
from .learned import Descriptors, LearnedModel
from .press_points import press_points
from .ridge import QuadraticRidge
from .table import Fit


@dataclass(frozen=True, eq=False)
class Surrogate:
    """What was learned.

    Attributes:
        descriptors: of stress and friction state.
        ridge, network: fits; `network` is either the trained one or the ONNX file's.
        meta: skin, device, friction and modulus it was made for, sample counts, test errors.
    """

    descriptors: Descriptors
    ridge: QuadraticRidge
    network: Fit
    meta: Mapping[str, Any]

    def model(self, skin: SkinModel, kind: str = "network") -> LearnedModel:
        """Return the forward model for a skin of this shape, of any stiffness.

        Raises:
            DermisError: neither 'network' nor 'ridge', or another skin.
        """
        if kind not in ("network", "ridge"):
            raise DermisError("unknown surrogate", where="thimble", value=kind, limit="network, ridge")
        check_made_for(self.meta, "skin", skin.key, "surrogate")
        fit = self.network if kind == "network" else self.ridge
        stiffness = skin.material.modulus / float(self.meta["modulus"])
        return LearnedModel(fit, self.descriptors.friction, stiffness, press_points(skin).nodal)


_WORDS = {"schema": "version of the product", "pressed_on": "kind of skin contact"}


def check_made_for(meta: Mapping[str, Any], name: str, wanted: Any, where: str) -> None:
    """Refuse a surrogate of another skin, device or friction than the one it is wanted for.

    Raises:
        DermisError: its `meta` says another `name`.
    """
    if meta.get(name) != wanted:
        raise DermisError(
            f"the surrogate was made for another {_WORDS.get(name, name)}",
            where=where,
            value=meta.get(name),
            limit=str(wanted),
            remedy="Adapt it to this one, or use the direct method",
        )
