"""Pin array: pins on a cylinder around the finger, which press the pulp.

Each pin moves towards the cylinder's axis. The origin of the finger's frame is the centre of the pad; +Y points to the
tip and +Z to the nail. The cylinder's axis runs along Y at the height `radius - standoff` above the pad. The cylinder
is then pitched about X by the mounting angle. A pin acts where its line of motion meets the undeformed skin. Its force
is spread over the skin's nodes around this point.

Source: [S1] IV.B.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError, Finding
from .spec import DeviceSpec

SPREAD_CUTOFF = 3.0  # [standard deviations] nodes farther from a pin's point of action get none of its force


@dataclass(frozen=True)
class PinLayout:
    """Places and limits of the pins.

    Attributes:
        tips: tips of the pins at mid stroke, on the cylinder [m], shape (pins, 3).
        directions: unit vectors of the pins' motion, into the finger, shape (pins, 3).
        force_limit: largest force of each pin [N], shape (pins,).
        stroke: travel of a pin from end to end [m].
        spread: standard deviation of the Gaussian that spreads a pin's force [m].
        delay: time from command to force [s].
    """

    tips: Array
    directions: Array
    force_limit: Array
    stroke: float
    spread: float
    delay: float

    @property
    def count(self) -> int:
        """Number of pins."""
        return len(self.tips)


@dataclass(frozen=True)
class PinContacts:
    """Points at which pins meet the skin.

    Attributes:
        points: points of action on the undeformed skin [m], shape (pins, 3); NaN for pins that miss it.
        hits: whether each pin meets the skin and is used, shape (pins,).
        travel: travel from mid stroke to the skin, positive inwards [m], shape (pins,); NaN for pins that miss it.
        findings: findings about pins that miss the skin, or whose stroke is too short to reach it.
    """

    points: Array
    hits: NDArray[np.bool_]
    travel: Array
    findings: tuple[Finding, ...]


def layout(spec: DeviceSpec) -> PinLayout:
    """Return the layout of a preset's pins in the finger's frame.

    The force of a pin is limited by 'force_limit' and by the 'high' of its channel, whichever is smaller.

    Raises:
        DermisError: there are no pins, there are more or fewer channels than pins, a pitch, radius, stroke, spread or
            force limit is not above zero, pins overlap, or the columns wrap more than half of the cylinder.
    """
    where = f"device preset '{spec.key}'"
    rows, columns = int(spec.value("rows")), int(spec.value("columns"))
    names = ("pitch", "cylinder_radius", "stroke", "spread", "force_limit", "delay")
    pitch, radius, stroke, spread, limit, delay = map(spec.value, names)
    mount, standoff, forward = map(spec.value, ("mount_pitch", "standoff", "forward"))
    angles = (np.arange(columns) - (columns - 1) / 2) * pitch / radius
    if columns > 1 and np.ptp(angles) > np.pi:
        raise DermisError(
            "the pins wrap more than half of the cylinder",
            where=where,
            value=f"{np.degrees(np.ptp(angles)):.0f} deg",
            limit="180 deg",
            remedy="Use fewer columns, a smaller pitch or a larger radius",
        )
    along = (np.arange(rows) - (rows - 1) / 2) * pitch + forward
    y, angle = (grid.ravel() for grid in np.meshgrid(along, angles, indexing="ij"))
    axis = radius - standoff
    tips = np.column_stack([radius * np.sin(angle), y, axis - radius * np.cos(angle)])
    directions = np.column_stack([-np.sin(angle), np.zeros_like(angle), np.cos(angle)])
    c, s = np.cos(mount), np.sin(mount)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    tips, directions = tips @ turn.T, directions @ turn.T
    _refuse_overlap(tips, spec.value("pin_radius"), where)
    return PinLayout(tips, directions, _force_limits(spec, len(tips), limit), stroke, spread, delay)


def _force_limits(spec: DeviceSpec, pins: int, limit: float) -> Array:
    """Return the force limit of each pin [N], shape (pins,).

    It is the smaller one of the parameter and the channel's 'high'.
    """
    where = f"device preset '{spec.key}'"
    if pins != len(spec.channels):
        raise DermisError(
            "the layout and the channels differ in number",
            where=where,
            value=f"{pins} pins, {len(spec.channels)} channels",
        )
    limits = np.array([limit if c.high is None else min(limit, c.high) for c in spec.channels])
    if not (limits > 0).all():
        weak = spec.channels[int(np.argmin(limits))]
        raise DermisError(
            "the force limit of a pin must be above 0", where=f"{where}, {weak.name}", value=weak.high, limit="> 0 N"
        )
    return limits


def contacts(pins: PinLayout, vertices: Array, triangles: NDArray[np.integer]) -> PinContacts:
    """Return the points at which the pins' lines meet the undeformed skin.

    A pin approaches from outside. Its point of action is the first crossing at which its line enters the skin.

    Args:
        pins: the layout.
        vertices, triangles: the skin's outer surface in the finger's frame [m], shapes (V, 3) and (T, 3).

    Raises:
        DermisError: no pin meets the skin.
    """
    points, travel = _first_entry(pins.tips, pins.directions, vertices, triangles)
    hits = np.isfinite(travel)
    findings = []
    if not hits.any():
        raise DermisError(
            "no pin of the layout meets the skin",
            where="pin array",
            remedy="Check the cylinder's radius, the standoff and the mounting angle",
        )
    if not hits.all():
        findings.append(
            Finding(
                "warning",
                "pin-misses",
                "pins miss the skin and are switched off",
                where="pin array",
                value=_names(np.flatnonzero(~hits)),
                count=int((~hits).sum()),
            )
        )
    short = hits & (np.abs(np.where(hits, travel, 0.0)) > pins.stroke / 2)
    if short.any():
        findings.append(
            Finding(
                "warning",
                "pin-stroke",
                f"pins must move up to {1e3 * np.abs(travel[short]).max():.2f} mm from mid stroke to reach the skin",
                where="pin array",
                limit=f"{1e3 * pins.stroke / 2:.2f} mm",
                remedy=f"Pins {_names(np.flatnonzero(short))}: move the standoff or the mounting angle",
                count=int(short.sum()),
            )
        )
    return PinContacts(points, hits, travel, tuple(findings))


def on_pad(pins: PinLayout, vertices: Array, triangles: NDArray[np.integer], nodes: Array) -> PinContacts:
    """Return the points of `contacts`, without pins that act beside the pad.

    A pin acts beside the pad if its point of action is farther than `SPREAD_CUTOFF` from all nodes that may carry
    force. Such a pin is not used, and a finding reports it.

    Args:
        pins: the layout.
        vertices, triangles: as in `contacts`.
        nodes: nodes of the skin that may carry force [m], shape (n, 3).

    Raises:
        DermisError: no pin is left.
    """
    met = contacts(pins, vertices, triangles)
    far = np.zeros(pins.count, dtype=bool)
    for pin in np.flatnonzero(met.hits):
        far[pin] = ((nodes - met.points[pin]) ** 2).sum(axis=1).min() > (SPREAD_CUTOFF * pins.spread) ** 2
    if not far.any():
        return met
    if not (met.hits & ~far).any():
        raise DermisError(
            "no pin of the layout meets the pad",
            where="pin array",
            remedy="Check the cylinder's radius, 'forward' and the mounting angle",
        )
    finding = Finding(
        "warning",
        "pin-off-pad",
        "pins meet the finger beside its pad and are switched off",
        where="pin array",
        value=_names(np.flatnonzero(far)),
        count=int(far.sum()),
    )
    return replace(met, hits=met.hits & ~far, findings=(*met.findings, finding))


def distribution(pins: PinLayout, met: PinContacts, nodes: Array) -> Array:
    """Return A = A_d A_p, nodal forces for unit pin forces, shape (3 n, pins).

    The weights of the nodes are a Gaussian of their distance from the point of action. Their sum is one, so the nodes
    together receive the pin's force exactly. Pins that are not used have a column of zeros.

    Args:
        pins: the layout.
        met: points at which the pins meet the skin.
        nodes: nodes of the skin that may carry force [m], shape (n, 3).

    Source: [S1] eq. 4 and IV.B.
    """
    a = np.zeros((len(nodes), 3, pins.count))
    for pin in np.flatnonzero(met.hits):
        squared = ((nodes - met.points[pin]) ** 2).sum(axis=1)
        near = squared <= max((SPREAD_CUTOFF * pins.spread) ** 2, squared.min())  # always at least the nearest node
        exponent = squared[near] / (2 * pins.spread**2)
        weights = np.exp(exponent.min() - exponent)
        weights /= weights.sum()
        a[near, :, pin] = weights[:, None] * pins.directions[pin]
    return a.reshape(3 * len(nodes), pins.count)


def _first_entry(
    origins: Array, directions: Array, vertices: Array, triangles: NDArray[np.integer]
) -> tuple[Array, Array]:
    """Return the first entry of each line into a surface.

    The method is that of Moeller and Trumbore.

    Returns:
        Point of the entry with the smallest signed travel [m], shape (pins, 3), and this travel [m], shape (pins,). NaN
        for lines that do not enter.
    """
    corner = vertices[triangles[:, 0]]
    e1, e2 = vertices[triangles[:, 1]] - corner, vertices[triangles[:, 2]] - corner
    p = np.cross(directions[:, None], e2[None])
    det = np.einsum("ptk,tk->pt", p, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origins[:, None] - corner[None]
        u = np.einsum("ptk,ptk->pt", s, p) / det
        q = np.cross(s, e1[None])
        v = np.einsum("ptk,pk->pt", q, directions) / det
        t = np.einsum("ptk,tk->pt", q, e2) / det
    edge = 1e-9  # a line through a shared edge crosses both triangles; without this margin it may cross none
    # The determinant is positive if the line runs against the outward normal, that is, enters.
    inside = (det > 0) & (u >= -edge) & (v >= -edge) & (u + v <= 1 + edge)
    travel = np.where(inside, t, np.inf).min(axis=1, initial=np.inf)
    travel[~np.isfinite(travel)] = np.nan
    return origins + travel[:, None] * directions, travel


def _refuse_overlap(tips: Array, pin_radius: float, where: str) -> None:
    apart = np.linalg.norm(tips[:, None] - tips[None], axis=2)
    apart[np.diag_indices(len(tips))] = np.inf
    i, j = np.unravel_index(int(np.argmin(apart)), apart.shape)
    if apart[i, j] < 2 * pin_radius:
        raise DermisError(
            "pins overlap",
            where=where,
            value=f"pins {i + 1} and {j + 1} are {1e3 * apart[i, j]:.3g} mm apart",
            limit=f"2 radii, {2e3 * pin_radius:.3g} mm",
        )


def _names(indices: NDArray[np.intp]) -> str:
    names = [str(i + 1) for i in indices[:12]]
    return ", ".join(names) + (" ..." if len(indices) > 12 else "")
