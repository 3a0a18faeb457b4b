"""Surrogate: all learned parts of a forward model for one skin and device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..devices.disc import DiscContact
from ..devices.disc_device import DiscDevice
from ..errors import DermisError
from ..skin.model import SkinModel
from .learned import Descriptors, LearnedModel
from .ridge import QuadraticRidge
from .table import Fit
from .trial import TrialForce


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Learned model of one skin and device.

    Attributes:
        descriptors: descriptors of stress, trial forces and friction state.
        ridge, network: the two fits; `network` is either a trained network or one from an ONNX file.
        meta: skin, device, friction and modulus for which the surrogate was made, numbers of samples and test errors.
    """

    descriptors: Descriptors
    ridge: QuadraticRidge
    network: Fit
    meta: Mapping[str, Any]

    def model(self, device: DiscDevice, skin: SkinModel, contact: DiscContact, kind: str = "network") -> LearnedModel:
        """Return the forward model of a device on a skin of the same shape.

        The skin can have any stiffness.

        Args:
            device: the device.
            skin: the skin.
            contact: contact of the device's disc with the skin.
            kind: fit of the model, 'network' or 'ridge'.

        Raises:
            DermisError: `kind` is unknown, or the surrogate was made for another skin.
        """
        if kind not in ("network", "ridge"):
            raise DermisError("unknown kind of surrogate", where="thimble", value=kind, limit="network, ridge")
        check_made_for(self.meta, "skin", skin.key, "surrogate")
        fit = self.network if kind == "network" else self.ridge
        stiffness = skin.material.modulus / float(self.meta["modulus"])
        spaces, trial = self.descriptors, TrialForce.of(contact)
        return LearnedModel(fit, device, trial, spaces.trial, spaces.friction, stiffness)


# Names of metadata in messages, where they differ from the keys.
_WORDS = {"schema": "version of the product", "pressed_on": "kind of skin contact"}


def check_made_for(meta: Mapping[str, Any], name: str, wanted: Any, where: str) -> None:
    """Check one property of a surrogate's metadata, such as its skin.

    Args:
        meta: metadata of the surrogate.
        name: name of the property.
        wanted: value that the property must have.
        where: name of the surrogate, for errors.

    Raises:
        DermisError: the property has another value.
    """
    if meta.get(name) != wanted:
        raise DermisError(
            f"the surrogate was made for another {_WORDS.get(name, name)}",
            where=where,
            value=meta.get(name),
            limit=str(wanted),
            remedy="Adapt it to this one, or use the direct method",
        )
