"""Pin array: the forces of the pins, sample by sample, with which they deform the skin as the virtual touch does.

Source: [S1] III and IV
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..contact.pad_contact import PadContact
from ..contact.skin_contact import SkinContact
from ..contact.solver.law_frame import USABLE
from ..devices import pin_array
from ..devices.pin_array import PinContacts, PinLayout
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..interpolate import interpolate, smoothstep
from ..parameters.device import DEVICE
from ..recent import Recent
from ..scene.tactile_scene import DeviceUse, TactileScene, device_times
from ..skin.model import SkinModel
from ..skin.observation import skin_key, stress_error
from ..skin.stimulus import Stimulus
from ..skin.stress import RECEPTOR_DEPTHS
from ..surface.gap import Surface
from ..track.command_track import CommandTrack
from . import pin_resolution
from .deformation import Matcher, Method, PinSolver
from .pin_law import MOST_LOOKS
from .rendered import Rendered

Weighting = Literal["all", "surface", "receptor"]
WEIGHTINGS: tuple[Weighting, ...] = get_args(Weighting)

_setups: Recent[tuple[str, float, str, str], PinSetup] = Recent(8)
_layouts: Recent[str, PinLayout] = Recent(8)
BLOCK = 512  # frames whose errors are computed together


@dataclass(frozen=True, eq=False)
class PinSetup:
    """All that does not change from frame to frame.

    Attributes:
        pins: the layout. met: the places at which its pins meet the skin. matcher: the matrices.
        distribution: A, forces on the pad's nodes for unit pin forces, shape (3 m, pins).
    """

    pins: PinLayout
    met: PinContacts
    matcher: Matcher
    distribution: Array


def setup(skin: SkinModel, spec: DeviceSpec, weighting: Weighting = "all") -> PinSetup:
    """Build the matrices of a skin and a pin array; the last few are kept, by skin and preset.

    Args:
        weighting: which nodes' displacements are compared: 'all' free nodes as in the paper, those of the 'surface',
            or those at 'receptor' depth under the pad.

    Raises:
        DermisError: a bad layout, one that misses the finger, or an unknown weighting.
    """
    if weighting not in WEIGHTINGS:
        raise DermisError("unknown weighting", where=spec.key, value=weighting, limit=", ".join(WEIGHTINGS))
    key = (skin_key(skin), skin.material.modulus, spec.hash, weighting)
    return _setups.make(key, lambda: _made(skin, spec, weighting))


def _made(skin: SkinModel, spec: DeviceSpec, weighting: Weighting) -> PinSetup:
    mesh = skin.mesh
    pins = _layout(spec)
    met = pin_array.on_pad(pins, mesh.nodes, mesh.surface, skin.positions)
    distribution = pin_array.distribution(pins, met, skin.positions)
    chosen = node_weights(skin, weighting)[mesh.free] > 0
    response = skin.unit_response[:, np.repeat(chosen, 3)]
    influence = response.T.astype(np.float64) / skin.material.modulus
    matcher = Matcher(
        distribution,
        influence,
        active=met.hits,
        tolerance=pin_resolution.tolerance_of(pins, met),
        law=skin.law if skin.follows_law else None,
        chosen=np.repeat(chosen, 3),
        modulus=skin.material.modulus,
    )
    return PinSetup(pins, met, matcher, distribution)


def _layout(spec: DeviceSpec) -> PinLayout:
    return _layouts.make(spec.hash, lambda: pin_array.layout(spec))


def node_weights(skin: SkinModel, weighting: Weighting) -> Array:
    """Return 1 for the nodes whose displacements a weighting compares, else 0, shape (nodes,)."""
    mesh = skin.mesh
    weights = np.zeros(len(mesh.nodes))
    if weighting == "all":
        weights[mesh.free] = 1.0
    elif weighting == "surface":
        weights[np.intersect1d(mesh.surface, mesh.free)] = 1.0
    else:
        on_pad = np.isin(mesh.surface, mesh.pad).all(axis=1)
        below = np.abs(Surface.build(mesh.nodes, mesh.surface[on_pad]).query(mesh.nodes[mesh.free]).gap)
        low, high = min(RECEPTOR_DEPTHS), max(RECEPTOR_DEPTHS)
        weights[mesh.free[(below >= low) & (below <= high)]] = 1.0
    return weights


def render(
    pad_contact: PadContact, scene: TactileScene, finger: int, use: DeviceUse, spec: DeviceSpec, skin: SkinContact
) -> Rendered:
    """Render one finger's pin array.

    The use's parameters: pin_method ('DM2'), pin_nodes (a weighting, 'all'), pin_bounded (True: within a pin's
    limits; False: the paper's form), pin_lead (True: the track leads by the device's delay), pin_fade_in and
    pin_fade_out [s].

    Signals have the times of the touch, also if the track is sent ahead (`pin_lead`): 'contact', 'displacement_error'
    u_err [m], 'stress_error' (of the whole stress, relative), 'force_error' f_err [N], 'target_force' and
    'rendered_force' along the pad's normal, 'target_shear' and 'rendered_shear' across it [N], 'at_limit' (number of
    pins). On neo-Hookean skin 'displacement_error' and 'stress_error' are computed with the neo-Hookean law.

    Raises:
        DermisError: an unknown method or weighting, a negative fade, or a bad layout.

    Source: [S1] eq. 6-21
    """
    p = use.parameters
    names = ("pin_method", "pin_nodes", "pin_bounded", "pin_fade_in", "pin_fade_out")
    method, nodes, bounded, *fades = (DEVICE[name].of(p, spec.key) for name in names)
    lead = _lead(p, spec)
    count = len(skin.times)
    times = device_times(scene, spec.rate)
    skipped = {"pin_frames_without_contact": count - len(skin.contact)}
    meta = {"method": str(method), "lead_s": f"{lead:.9g}"}
    if not len(skin.contact):  # nothing to match, so nothing to build
        _layout(spec)  # a bad layout is refused now, not only when something is touched
        nothing = {name: np.zeros(len(times)) for name in _SIGNALS}
        return Rendered(
            CommandTrack(spec, times, np.zeros((len(times), len(spec.channels))), meta), nothing, (), skipped
        )
    ready = setup(skin.model, spec, nodes)
    solver = make_solver(ready, spec, method, skin.times, bounded=bool(bounded))
    matched = match(solver, skin)
    forces, series = matched.forces, _series(matched, ready, skin)
    values = interpolate(skin.times, forces, np.minimum(times + lead, skin.times[-1]))
    values = values * _fade(times, *fades)[:, None]
    signals = {name: interpolate(skin.times, s[:, None], times)[:, 0] for name, s in series.items()}
    where = f"finger '{scene.fingers[finger].name}', pin array"
    met = [replace(finding, where=where) for finding in ready.met.findings]  # a setup is shared by fingers
    coarse = pin_resolution.doubts(ready.matcher, ready.distribution, (method,), where)
    findings = [*met, *coarse, *_findings(series, ready, matched, skin.frames, where)]
    meta["worst_kkt"] = f"{matched.worst:.2g}"
    return Rendered(CommandTrack(spec, times, values, meta), signals, tuple(findings), skipped)


@dataclass(frozen=True, eq=False)
class Matched:
    """Pin forces of a whole path.

    Attributes:
        forces: zero without contact [N], shape (n, pins).
        displacement_error, force_error: u_err [m] and f_err [N], 0 without contact, shape (n,).
        at_limit: pins at their upper bound, shape (n,).
        worst: largest KKT residual. unsolved: frames that did not converge.
        stress_error: error of the whole stress, relative to the target's, 0 without contact, shape (n,).
        looks: number of evaluations of the nonlinear law, 0 on linear skin, shape (n,).
        unsettled: residual of the law under the pins' forces if it did not converge, else 0, shape (n,).
    """

    forces: Array
    displacement_error: Array
    force_error: Array
    at_limit: Array
    worst: float
    unsolved: int
    stress_error: Array
    looks: NDArray[np.int64]
    unsettled: Array


def make_solver(
    ready: PinSetup, spec: DeviceSpec, method: Method, times: Array | None, *, bounded: bool = True
) -> PinSolver:
    """Return a solver that keeps a device's limits.

    Forces are limited if `bounded`. Their change per second is limited if the device has such a limit.

    Args:
        times: time of each frame [s]; None for a single frame: the change of force is then not limited.
    """
    step = float(np.median(np.diff(times))) if times is not None and len(times) > 1 else 1.0 / spec.rate
    slew = None if times is None else min((c.slew for c in spec.channels if c.slew is not None), default=None)
    return PinSolver(
        ready.matcher,
        method,
        force_limit=ready.pins.force_limit if bounded else None,
        slew=None if slew is None else slew * step,
    )


def match(solver: PinSolver, skin: SkinContact) -> Matched:
    """Match every frame in which the skin touches something."""
    matcher, count = solver.matcher, len(skin.times)
    forces = np.zeros((count, matcher.pins))
    u, f, at_limit = np.zeros(count), np.zeros(count), np.zeros(count)
    stress, looks, unsettled = np.zeros(count), np.zeros(count, np.int64), np.zeros(count)
    worst, unsolved, before = 0.0, 0, -2
    felt = skin.force
    for start in range(0, len(skin.contact), BLOCK):
        frames = skin.contact[start : start + BLOCK]
        targets = felt[start : start + BLOCK].reshape(len(frames), -1).astype(np.float64)
        active_forces = np.zeros((len(frames), len(matcher.active)))
        for row, (i, target) in enumerate(zip(frames.tolist(), targets, strict=True)):
            if i != before + 1:
                solver.reset()
            before, step = i, solver.step(target, skin.amounts_at(i))
            active_forces[row] = step.x
            at_limit[i] = solver.at_limit(step.x)
            worst, unsolved = max(worst, step.optimality), unsolved + (not step.converged)
            pressed = matcher.pressed(step.x)
            made = Stimulus(skin.model, pressed)
            if step.look is not None:
                u[i], looks[i], made = step.displacement_error, step.look.looks, step.look.felt(skin.model, pressed)
                unsettled[i] = 0.0 if step.look.settled else max(step.look.left, 1e-12)
            stress[i] = stress_error(Stimulus(skin.model, target.reshape(-1, 3), None, skin.amounts_at(i)), made)
        forces[np.ix_(frames, matcher.active)] = active_forces
        if matcher.law is None:
            u[frames] = matcher.displacement_error(targets, active_forces)
        f[frames] = matcher.force_error(targets, active_forces)
    return Matched(forces, u, f, at_limit, worst, unsolved, stress, looks, unsettled)


def rendered_force(ready: PinSetup, forces: Array) -> Array:
    """Return the forces on the pad's nodes [N], shape (m, 3), for forces of the pins [N], shape (pins,).

    `Stimulus(skin, rendered_force(...))` is the state of the skin under the pins; compare it with that of the touch,
    `Stimulus(skin, target)`.

    Source: [S1] eq. 4
    """
    return (ready.distribution @ forces).reshape(-1, 3)


def _series(matched: Matched, ready: PinSetup, skin: SkinContact) -> dict[str, Array]:
    count = len(skin.times)
    series = {name: np.zeros(count) for name in _SIGNALS}
    total = skin.force.astype(np.float64).sum(axis=1)
    shown = matched.forces @ ready.pins.directions
    series["contact"][skin.contact] = 1.0
    series["displacement_error"], series["force_error"] = matched.displacement_error, matched.force_error
    series["at_limit"], series["stress_error"] = matched.at_limit, matched.stress_error
    series["target_force"][skin.contact] = total[:, 2]
    series["target_shear"][skin.contact] = np.hypot(total[:, 0], total[:, 1])
    series["rendered_force"], series["rendered_shear"] = shown[:, 2], np.hypot(shown[:, 0], shown[:, 1])
    return series


_SIGNALS = (
    "contact",
    "displacement_error",
    "stress_error",
    "force_error",
    "target_force",
    "target_shear",
    "rendered_force",
    "rendered_shear",
    "at_limit",
)


def _lead(parameters: Mapping[str, Any], spec: DeviceSpec) -> float:
    """Return the lead of the track [s], which cancels the device's delay."""
    delay = float(spec.value("delay"))
    return delay if DEVICE["pin_lead"].of(parameters, spec.key) else 0.0


def _fade(times: Array, fade_in: float, fade_out: float) -> Array:
    """Rise from 0 at the first time and fall to 0 at the last, both smooth."""
    gain = np.ones_like(times)
    if fade_in > 0:
        gain *= smoothstep((times - times[0]) / fade_in)
    if fade_out > 0:
        gain *= smoothstep((times[-1] - times) / fade_out)
    return gain


def _findings(series: dict[str, Array], ready: PinSetup, matched: Matched, frames: Array, where: str) -> list[Finding]:
    found = []
    limited = np.flatnonzero(series["at_limit"])
    if len(limited):
        found.append(
            Finding(
                "info",
                "pins-at-limit",
                "pins are at their force limit, so the target deformation is not reached",
                where,
                f"up to {int(series['at_limit'].max())} pins",
                f"{ready.pins.force_limit.max():g} N a pin",
                "Check how large the displacement error is, or touch less deeply",
                frame=float(frames[limited[0]]),
                count=len(limited),
            )
        )
    if matched.unsolved:
        what = "pin forces are not optimal"
        found.append(Finding("warning", "pins-not-converged", what, where, count=matched.unsolved))
    astray = np.flatnonzero(matched.unsettled)
    if len(astray):
        found.append(
            Finding(
                "warning",
                "law-unsettled",
                "the neo-Hookean law did not converge under the pins: in frames with a remaining error "
                f"above {100 * USABLE:g} %, displacement and stress errors are those of linear tissue",
                where,
                f"remaining error: {100 * min(float(matched.unsettled.max()), 1.0):.0f} % of the forces",
                f"convergence within {MOST_LOOKS} evaluations of the law",
                "Use DM2 or FM2, which keep within the limits of the pins, or touch less deeply",
                frame=float(frames[astray[0]]),
                count=len(astray),
            )
        )
    return found
