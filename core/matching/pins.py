"""Pin array: what every pin shall press, sample by sample, so that the skin is deformed as by the virtual touch.

Source: [S1] III and IV
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..contact.gap import Surface
from ..contact.sampled import SampledTouch
from ..contact.skin_touch import SkinTouch
from ..devices import pin_array
from ..devices.pin_array import PinContacts, PinLayout
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..interpolate import interpolate
from ..scene import DeviceUse, TactileScene, sample_count
from ..skin.model import SkinModel
from ..track import CommandTrack
from .deformation import METHODS, Matcher, PinSolver
from .rendered import Rendered

Array = NDArray[np.float64]
Weighting = Literal["all", "surface", "receptor"]
WEIGHTINGS: tuple[Weighting, ...] = get_args(Weighting)

RECEPTOR_BAND = (0.3e-3, 2.0e-3)  # [m] below the pad. Source: TouchSim's fitted depths of SA1 to PC
FADE = 0.1  # [s] default length of fade-in and fade-out; chosen


@dataclass(frozen=True, eq=False)
class PinSetup:
    """All that does not change from frame to frame.

    Attributes:
        pins: the layout. met: where its pins meet the skin. matcher: the matrices.
    """

    pins: PinLayout
    met: PinContacts
    matcher: Matcher


def setup(skin: SkinModel, spec: DeviceSpec, weighting: Weighting = "all") -> PinSetup:
    """Build the matrices of a skin and a pin array; kept for as long as the skin lives.

    Args:
        weighting: which nodes' displacements are compared: 'all' free nodes as in the paper, those of the 'surface',
            or those at 'receptor' depth under the pad.

    Raises:
        DermisError: a bad layout, one that misses the finger, or an unknown weighting.
    """
    if weighting not in WEIGHTINGS:
        raise DermisError("unknown weighting", where=spec.key, value=weighting, limit=", ".join(WEIGHTINGS))
    kept = _SETUPS.setdefault(skin, {})
    key = (spec.hash, weighting)
    if key not in kept:
        mesh = skin.mesh
        pins = pin_array.layout(spec)
        if pins.count != len(spec.channels):
            raise DermisError(
                "the layout and the channels differ in number",
                where=f"device preset '{spec.key}'",
                value=f"{pins.count} pins, {len(spec.channels)} channels",
            )
        met = pin_array.contacts(pins, mesh.nodes, mesh.surface)
        spread = pin_array.distribution(pins, met, skin.positions)
        chosen = node_weights(skin, weighting)[mesh.free] > 0
        response = skin.unit_response[:, np.repeat(chosen, 3)]
        influence = response.T.astype(np.float64) / skin.material.modulus
        kept[key] = PinSetup(pins, met, Matcher(spread, influence, active=met.hits))
    return kept[key]


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
        low, high = RECEPTOR_BAND
        weights[mesh.free[(below >= low) & (below <= high)]] = 1.0
    return weights


def render(
    touch: SampledTouch, scene: TactileScene, finger: int, use: DeviceUse, spec: DeviceSpec, skin: SkinTouch
) -> Rendered:
    """Render one finger's pin array.

    The use's parameters: method (DM2), weighting ('all'), bounded (True: what a pin can do; False: the paper's form),
    lead (True: the track leads by the device's delay), fade_in and fade_out [s].

    Signals: 'contact', 'displacement_error' u_err [m], 'force_error' f_err [N], 'target_force', 'rendered_force' along
    the pad's normal [N], 'at_limit' (pins).

    Raises:
        DermisError: an unknown method or weighting, a negative fade, or a bad layout.

    Source: [S1] eq. 6-21
    """
    p = use.parameters
    method = p.get("method", "DM2")
    if method not in METHODS:
        raise DermisError("unknown matching method", where=spec.key, value=method, limit=", ".join(METHODS))
    ready = setup(skin.model, spec, p.get("weighting", "all"))
    step = float(np.median(np.diff(skin.times))) if len(skin.times) > 1 else 1.0 / spec.rate
    slew = min((c.slew for c in spec.channels if c.slew is not None), default=None)
    solver = PinSolver(
        ready.matcher,
        method,
        force_limit=ready.pins.force_limit if p.get("bounded", True) else None,
        slew=None if slew is None else slew * step,
    )
    count = len(skin.times)
    forces = np.zeros((count, ready.pins.count))
    series = {name: np.zeros(count) for name in _SIGNALS}
    worst, unsolved = 0.0, 0
    for i, force in zip(skin.contact, skin.force, strict=True):
        if i > 0 and not series["contact"][i - 1]:
            solver.reset()
        found = solver.solve(force.astype(np.float64))
        forces[i] = found.forces
        series["contact"][i] = 1.0
        series["displacement_error"][i] = found.displacement_error
        series["force_error"][i] = found.force_error
        series["target_force"][i] = float(force[:, 2].sum())
        series["rendered_force"][i] = float(found.forces @ ready.pins.directions[:, 2])
        series["at_limit"][i] = found.at_limit
        worst, unsolved = max(worst, found.optimality), unsolved + (not found.converged)
    lead = ready.pins.delay if p.get("lead", True) else 0.0
    times = np.arange(sample_count(scene.fps, scene.frame_range, spec.rate)) / spec.rate
    values = interpolate(skin.times, forces, np.minimum(times + lead, skin.times[-1])) if count > 1 else forces
    values = values * _fade(times, _length(p, "fade_in"), _length(p, "fade_out"))[:, None]
    signals = (
        {name: interpolate(skin.times, s[:, None], times)[:, 0] for name, s in series.items()} if count > 1 else series
    )
    findings = [*ready.met.findings, *_findings(series, forces, ready, unsolved, skin.frames)]
    meta = {"method": str(method), "lead_s": f"{lead:.9g}", "worst_kkt": f"{worst:.2g}"}
    skipped = {"pin_frames_without_contact": count - len(skin.contact)}
    return Rendered(CommandTrack(spec, times, values, meta), signals, tuple(findings), skipped)


_SIGNALS = ("contact", "displacement_error", "force_error", "target_force", "rendered_force", "at_limit")
_SETUPS: weakref.WeakKeyDictionary[SkinModel, dict[tuple[str, str], PinSetup]] = weakref.WeakKeyDictionary()


def _length(parameters: object, name: str) -> float:
    value = float(parameters.get(name, FADE))  # type: ignore[attr-defined]
    if not (np.isfinite(value) and value >= 0):
        raise DermisError("a fade cannot be negative", where=name, value=value, limit=">= 0 s")
    return value


def _fade(times: Array, fade_in: float, fade_out: float) -> Array:
    """Rise from 0 at the first time and fall to 0 at the last, both smooth."""
    gain = np.ones_like(times)
    if fade_in > 0:
        gain *= _smooth((times - times[0]) / fade_in)
    if fade_out > 0:
        gain *= _smooth((times[-1] - times) / fade_out)
    return gain


def _smooth(x: Array) -> Array:
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def _findings(series: dict[str, Array], forces: Array, ready: PinSetup, unsolved: int, frames: Array) -> list[Finding]:
    found = []
    limited = np.flatnonzero(series["at_limit"])
    if len(limited):
        found.append(
            Finding(
                "info",
                "pins-at-limit",
                "pins press as hard as they can, so the skin is not deformed as wanted",
                "pin array",
                f"up to {int(series['at_limit'].max())} pins",
                f"{ready.pins.force_limit:g} N a pin",
                "Compare the displacement error, or touch less deeply",
                frame=float(frames[limited[0]]),
                count=len(limited),
            )
        )
    if unsolved:
        found.append(
            Finding("warning", "pins-not-converged", "pin forces are not optimal", "pin array", count=unsolved)
        )
    return found
