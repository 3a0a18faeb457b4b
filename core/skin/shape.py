"""FingertipShape: smooth surfaces of a fingertip and its bone.

The surfaces are functions of a few lengths.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from ..parameters.skin import LENGTHS

# Narrowing of the finger far behind the pad's centre, as a share of half the section. The palmar side recedes towards
# the crease of the joint; the sides and the back are almost straight.
WAIST_PALM, WAIST_SIDE, WAIST_BACK = 0.12, 0.05, 0.02
PALM_SHARE = 0.54  # height of the widest section above the pad, as a share of the thickness
MIN_TISSUE = 0.4e-3  # least thickness of tissue between bone and skin that can be meshed without slivers [m]


@dataclass(frozen=True)
class FingertipShape:
    """Lengths of a fingertip [m].

    The origin is at the pad's centre, +Y points to the tip and +Z to the nail.

    Attributes:
        width, thickness: size of the finger at the pad's centre, along X and Z.
        length: length from the cut end to the tip, along Y.
        tip: length from the pad's centre to the tip, along Y.
        nail_width, nail_length: size of the nail.
        nail_margin: length from the tip back to the nail's front edge, along Y.
        bone_width, bone_thickness: size of the shaft of the distal phalanx.
        bone_bed: thickness of tissue between the bone and the back of the finger.
        bone_margin: thickness of tissue between the bone's end and the tip, along Y.

    Raises:
        DermisError: a length is not above zero, or lengths do not fit each other.
    """

    width: float = LENGTHS["width"].default
    thickness: float = LENGTHS["thickness"].default
    length: float = LENGTHS["length"].default
    tip: float = LENGTHS["tip"].default
    nail_width: float = LENGTHS["nail_width"].default
    nail_length: float = LENGTHS["nail_length"].default
    nail_margin: float = LENGTHS["nail_margin"].default
    bone_width: float = LENGTHS["bone_width"].default
    bone_thickness: float = LENGTHS["bone_thickness"].default
    bone_bed: float = LENGTHS["bone_bed"].default
    bone_margin: float = LENGTHS["bone_margin"].default

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value > 0):
                raise DermisError("must be above zero", where=f"fingertip, {field.name}", value=value, limit="> 0 m")
        self._below("tip", self.tip, "length", self.length / 1.2)
        self._below("nail_width", self.nail_width, "width", self.width)
        self._below("nail_margin + nail_length", self.nail_margin + self.nail_length, "length", self.length)
        self._below("bone_width", self.bone_width, "width - tissue", self.width - 2 * MIN_TISSUE)
        room = self.thickness * PALM_SHARE - MIN_TISSUE + self.height_back
        self._below("bone_bed + bone_thickness", self.bone_bed + self.bone_thickness, "thickness - tissue", room)
        head = self.bone_margin + self.bone_width / 2
        self._below("bone_margin + half the bone's width", head, "length", self.length)
        if self.bone_bed < MIN_TISSUE or self.bone_margin < MIN_TISSUE:
            raise DermisError(
                "too little soft tissue round the bone",
                where="fingertip, bone_bed or bone_margin",
                value=min(self.bone_bed, self.bone_margin),
                limit=f">= {MIN_TISSUE} m",
            )

    @property
    def height_palm(self) -> float:
        """Height of the widest section above the pad [m]."""
        return self.thickness * PALM_SHARE

    @property
    def height_back(self) -> float:
        """Height of the back above the widest section [m]."""
        return self.thickness * (1.0 - PALM_SHARE)

    @property
    def pulp(self) -> float:
        """Thickness of tissue between the pad's centre and the bone [m]."""
        return self.thickness - self.bone_bed - self.bone_thickness

    @property
    def reach(self) -> float:
        """Length of the finger behind the pad's centre, divided by `tip`.

        It is also the logarithm of the outer radius of the plane in `_tube`.
        """
        return (self.length - self.tip) / self.tip

    @classmethod
    def scaled(cls, width: float, thickness: float, length: float, **lengths: float) -> FingertipShape:
        """Return a fingertip with given outer lengths [m].

        Args:
            width, thickness, length: outer lengths, see the class.
            lengths: other lengths; those that are not given are scaled with the outer ones.
        """
        base = cls()
        along, across, up = length / base.length, width / base.width, thickness / base.thickness
        own = {
            "tip": base.tip * along,
            "nail_width": base.nail_width * across,
            "nail_length": base.nail_length * along,
            "nail_margin": base.nail_margin * along,
            "bone_width": base.bone_width * across,
            "bone_thickness": base.bone_thickness * up,
            "bone_bed": base.bone_bed * up,
            "bone_margin": base.bone_margin * along,
        }
        return cls(width=width, thickness=thickness, length=length, **{**own, **lengths})

    def skin(self, chart: NDArray[np.complex128]) -> Array:
        """Return points of the skin.

        Args:
            chart: points of the closed unit disk, shape (...). 0 is the pad's centre, and the rim is the cut end. The
                imaginary axis points along -X, and the negative real axis leads over the tip to the nail.

        Returns:
            Points [m], shape (..., 3).
        """
        radius, angle, axial = self._tube(chart)
        q2 = np.minimum(axial, 0.0) ** 2
        cosine, sine = angle.real, angle.imag
        back = np.where(cosine < 0, WAIST_BACK, WAIST_PALM)
        height = np.where(cosine < 0, self.height_back, self.height_palm)
        x = -0.5 * self.width * radius * _waist(q2, WAIST_SIDE) * sine
        z = self.height_palm - height * radius * _waist(q2, back) * cosine
        return np.stack([x, self.tip * axial, z], axis=-1)

    def bone(self, chart: NDArray[np.complex128]) -> Array:
        """Return points of the bone's surface [m], shape (..., 3).

        Args:
            chart: points of the closed unit disk, see `skin`, shape (...).
        """
        radius, angle, axial = self._tube(chart)
        half = 0.5 * self.bone_width
        centre = self.tip - self.bone_margin - half
        # A point of the bone and a point of the skin correspond to each other. Towards the cut end, both approach the
        # same cross-section, so that the layers between them are not sheared where the tissue is thin.
        behind = np.maximum(-axial, 0.0)
        y = half * np.maximum(axial, 0.0) - self.tip * behind + centre * (1.0 - behind / self.reach) ** 2
        middle = self.thickness - self.bone_bed - 0.5 * self.bone_thickness
        x = -half * radius * angle.imag
        z = middle - 0.5 * self.bone_thickness * radius * angle.real
        return np.stack([x, y, z], axis=-1)

    def under_nail(self, points: Array) -> NDArray[np.bool_]:
        """Return whether the nail covers points of the skin, shape (...).

        Args:
            points: points of the skin [m], shape (..., 3).
        """
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        front = self.tip - self.nail_margin
        along = (y <= front) & (y >= front - self.nail_length)
        return along & (np.abs(x) <= 0.5 * self.nail_width) & (z > self.height_palm)

    def _tube(self, chart: NDArray[np.complex128]) -> tuple[Array, NDArray[np.complex128], Array]:
        """Return cylindrical coordinates of points of the disk, see `skin`.

        Returns:
            Radius relative to the section's; direction around the axis as a complex number, 1 at the palm; axial
            position in units of `tip`, 1 at the tip. The shape of each is that of the points.
        """
        # The map is conformal, so that squares stay nearly square. A Moebius map takes the disk to a disk of the
        # plane in which 0 is the tip and 1 the pad's centre. Outside the unit circle, the logarithm of the radius is
        # the position along the finger. Inside, a stereographic projection closes the tip.
        p = np.exp(-self.reach)
        plane = (chart + p) / (1.0 + p * chart) / p
        size = np.abs(plane)
        angle = np.where(size > 0, plane / np.where(size > 0, size, 1.0), 1.0)
        front = np.minimum(size, 1.0)
        radius = np.where(size < 1, 2 * front / (1 + front**2), 1.0)
        axial = np.where(size < 1, (1 - front**2) / (1 + front**2), -np.log(np.maximum(size, 1.0)))
        return radius, angle, axial

    def _below(self, name: str, value: float, other: str, limit: float) -> None:
        if not value < limit:
            raise DermisError(
                "does not fit into the finger",
                where=f"fingertip, {name}",
                value=f"{value * 1e3:.2f} mm",
                limit=f"below {limit * 1e3:.2f} mm ({other})",
                remedy="Make it smaller, or the finger larger",
            )


def shape_from_parameters(parameters: dict[str, Any], *, where: str = "fingertip") -> FingertipShape:
    """Return the shape of a fingertip for named lengths [m].

    Other lengths are scaled, see `FingertipShape.scaled`.

    Raises:
        DermisError: a name is unknown, or lengths do not fit each other.
    """
    for name in parameters:
        if name not in LENGTHS:
            raise DermisError("unknown length", where=where, value=name, limit=", ".join(LENGTHS))
    given = {name: float(row.of(parameters, where)) for name, row in LENGTHS.items()}
    rest = {name: given[name] for name in parameters if name not in ("width", "thickness", "length")}
    return FingertipShape.scaled(given["width"], given["thickness"], given["length"], **rest)


def _waist(q2: Array, drop: Array | float) -> Array:
    """Return the factor that narrows a section behind the pad's centre.

    Near the pad's centre, it continues the curvature of the pad up to second order. Far behind, it approaches 1 - drop.

    Args:
        q2: square of the axial position behind the pad's centre.
        drop: narrowing far behind the pad.
    """
    return 1.0 - 0.5 * q2 / (1.0 + q2 / (2.0 * np.asarray(drop)))
