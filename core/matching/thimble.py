"""Thimble: find the joint values whose touch on the skin matches a target, over a whole sequence, by any method.

The device is a thimble with three servos, or a platform on six legs that is matched like a thimble.

One operator maps forces on the mesh's nodes to stress descriptors. It is applied to the target and to the device, so
its discretisation error is the same on both sides. The contact is discretised in the same way on both sides, too: if
the virtual touch is solved on points of the smooth skin, so is the contact of the disc. Each is converted to forces on
the nodes. The conversion keeps the sum of the forces; on linear skin it keeps their moment, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..cache import cache_key
from ..devices.disc_device import DiscDevice
from ..devices.spec import DeviceSpec
from ..devices.thimble import MIN_MARGIN
from ..errors import DermisError, Finding, Severity
from ..parameters.material import FRICTION
from ..recent import Recent
from ..scene.tactile_scene import DeviceUse, TactileScene, device_times
from ..skin.model import SkinModel
from ..skin.observation import Observation, Observer, stress_error, touch_of
from ..skin.stimulus import Stimulus
from ..surrogate.forward import DirectModel, ForwardModel
from ..surrogate.press_points import pressed_on
from ..surrogate.store import contact_of, device_key
from ..track.command_track import CommandTrack
from ..version import version
from .baselines import contact_patch, fit_plane, total_force
from .description import observation_of
from .rendered import Rendered
from .stress import MISTRUST, MOST_LOOKS, StressMatcher, ThimbleFrame
from .thimble_sequence import ThimbleSequence, collect
from .thimble_use import HOVER, LEARNED, METHODS, ThimbleUse, prepare
from .warm_start import WarmStartTable, kept_table

if TYPE_CHECKING:
    from ..contact.pad_contact import PadContact
    from ..contact.skin_contact import SkinContact


# Shares of the touched samples above which a finding is a warning instead of information:
LATE = 0.05  # samples in which the disc does not reach the skin in time
MAX_STEEP = 0.05  # samples in which the target is too steep for the mechanism
DOUBTFUL = 0.1  # samples in which the direct search replaced a surrogate

UNFINISHED = 0.05  # the finding 'at-a-kink' counts samples with a larger KKT residual

_tables: Recent[str, WarmStartTable] = Recent(8)


def matcher(
    device: DiscDevice,
    skin: SkinModel,
    method: str = "stress",
    *,
    friction: float = FRICTION,
    observation_matrix: Array | Observation | None = None,
    model: ForwardModel | None = None,
    change: float | None = None,
    hover: float = HOVER,
) -> StressMatcher:
    """Return a matcher that follows targets by a method.

    Args:
        device: the mechanism.
        skin: model of the skin under the disc.
        method: one of `METHODS`.
        friction: friction coefficient between disc and skin.
        observation_matrix: maps forces on the pad nodes to the quantity compared, shape (k, 3 m), or an `Observation`.
            None uses `observation_of`. The method 'force' does not use it.
        model: learned model of the methods 'network' and 'ridge'.
        change: largest change of a joint from frame to frame [rad for servos, m for legs]; None for no limit.
        hover: distance of the disc from the skin while nothing is touched [m].

    Raises:
        DermisError: the method is unknown, a learned method has no model, or the servo limits exclude contact.
    """
    if method not in METHODS:
        raise DermisError("unknown method", where="thimble", value=method, limit=", ".join(METHODS))
    if method in LEARNED and model is None:
        raise DermisError(
            "the method needs a surrogate",
            where="thimble",
            value=method,
            remedy="Adapt one to this finger, or use the direct method",
        )
    contact = contact_of(device, skin, friction)
    if method == "force":
        observation_matrix = Observation(total_force(skin.pad_count), stress=False)
    elif observation_matrix is None:
        observation_matrix = observation_of(device, skin, friction)
    observer = Observer(skin, observation_matrix)
    table, learned = None, model if method in LEARNED else None
    if learned is None:  # the table is kept in memory, so fingers with the same skin and device share it
        what = (skin.key, pressed_on(skin), repr(skin.material), device_key(device), repr(friction))
        key = cache_key(version(), *what, observer.matrix.tobytes(), "warm start")
        made = partial(DirectModel, device, contact, observer)
        table = _tables.make(key, lambda: kept_table(skin.cache, key, device, contact, made()))
    return StressMatcher(device, contact, observer, learned, change=change, hover=hover, table=table)


class Follower:
    """Follows a virtual touch with a thimble, one frame after the other.

    Args:
        matching: the matcher, see `matcher`.
        skin: model of the skin, the same as the matcher's.
        method: the matcher's method, one of `METHODS`.
    """

    def __init__(self, matching: StressMatcher, skin: SkinModel, method: str) -> None:
        self.matching, self.skin, self.method = matching, skin, method

    def step(self, force: Array, amounts: Array | None = None) -> ThimbleFrame:
        """Return the device's next frame.

        Args:
            force: forces of the virtual touch on the pad nodes [N], shape (m, 3) or (3 m,).
            amounts: displacement of the pad in linear skin minus its displacement in nonlinear skin [m], see
                `Stimulus.given`, shape (3 m,). None computes it from the forces.

        Raises:
            DermisError: a force is not finite.
        """
        touch = touch_of(self.skin, force, amounts)
        frame = self._followed(touch.force, amounts, self._observer.see(touch))
        if frame.minimum is None:
            return frame
        felt = frame.felt or Stimulus(self.skin, self.matching.contact.nodal(frame.solution))
        return replace(frame, stress_error=stress_error(touch, felt), felt=None)

    @property
    def _observer(self) -> Observer:
        observer = self.matching.direct.observer
        assert observer is not None
        return observer

    def _followed(self, force: Array, amounts: Array | None, target: Array) -> ThimbleFrame:
        """Return the next frame for a touch, shape (m, 3), and the quantity that is compared, shape (k,)."""
        if self.method != "geometry" or not target.any():
            return self.matching.step(target)
        patch = contact_patch(self.skin, force, amounts)
        return self.matching.step(target, lambda x, limits: fit_plane(self.matching.device, patch, x, limits))

    def follow(self, forces: Array, amounts: Array | None = None) -> ThimbleSequence:
        """Follow a sequence of touches.

        Args:
            forces: forces on the pad nodes [N], shape (n, m, 3) or (n, 3 m).
            amounts: as in `step` [m], shape (n, 3 m).

        Raises:
            DermisError: the forces do not fit the skin or are not finite.
        """
        forces = np.asarray(forces, np.float64).reshape(len(forces), -1)
        nodes = self.skin.pad_count
        if forces.shape[1] != 3 * nodes or not np.isfinite(forces).all():
            raise DermisError(
                "the target's forces do not fit the skin or are not finite",
                where="thimble",
                value=forces.shape,
                limit=f"(n, {3 * nodes})",
            )
        given = [None] * len(forces) if amounts is None else amounts
        if self.skin.follows_law:
            frames = [self.step(force, own) for force, own in zip(forces, given, strict=True)]
            return collect(frames, self.matching.contact, self.method)
        targets, forces = map(self._observer.linear, forces), forces.reshape(len(forces), nodes, 3)
        frames = [self._followed(*touch) for touch in zip(forces, given, targets, strict=True)]
        return collect(frames, self.matching.contact, self.method, self.skin, forces)


def follower(use: ThimbleUse, change: float | None = None) -> Follower:
    """Return a follower for the use of a thimble on one finger.

    Args:
        use: device, skin and method, see `prepare`.
        change: largest change of a joint from frame to frame, see `matcher`.

    Raises:
        DermisError: the servo limits exclude contact.
    """
    matching = matcher(
        use.device,
        use.skin,
        use.method,
        friction=use.friction,
        observation_matrix=use.observation_matrix,
        model=use.learned,
        change=change,
        hover=use.hover,
    )
    return Follower(matching, use.skin, use.method)


def match_touch(
    use: ThimbleUse, forces: Array, change: float | None = None, amounts: Array | None = None
) -> ThimbleSequence:
    """Match a sequence of virtual touches; arguments as in `follower` and `Follower.follow`."""
    return follower(use, change).follow(forces, amounts)


def match_stimuli(matching: StressMatcher, stimuli: Array) -> ThimbleSequence:
    """Match a recorded sequence of stimuli.

    Args:
        matching: the matcher.
        stimuli: the quantity that the matcher compares, one row for each frame, shape (n, k). A row of zeros is a frame
            without touch.
    """
    return collect(list(matching.follow(np.asarray(stimuli, np.float64))), matching.contact, "stress")


def render(
    pad_contact: PadContact, scene: TactileScene, finger: int, use: DeviceUse, spec: DeviceSpec, skin: SkinContact
) -> Rendered:
    """Render the thimble of one finger, or six legs that are matched like a thimble.

    The parameters of the use are described in `prepare`. The result has these signals, each of shape (n,):

    * 'contact': 1 if the target is a touch, else 0.
    * 'mismatch': relative error of the quantity that the method compares.
    * 'stress_error': error of the whole stress, relative to the target's.
    * 'normal_force': sum of the device's forces along the finger's Z axis [N].
    * 'target_force': the same of the virtual touch [N].
    * 'rescued', for learned methods only: 1 if the direct search replaced the learned model.

    For skin with a nonlinear law, both errors are computed with that law.

    Raises:
        DermisError: the method is unknown, or the device cannot touch this finger.

    Source: [S0] 5
    """
    where = f"finger '{scene.fingers[finger].name}', {spec.key}"
    prepared = prepare(spec, skin.pressed, use.parameters, where)
    times = device_times(scene, spec.rate)
    forces = forces_at(skin, times)
    found = match_touch(prepared, forces, prepared.device.servo_speed / spec.rate, amounts_at(skin, times))
    findings = [*prepared.findings, *findings_of(found, where)]
    track = CommandTrack(spec, times, found.commands(spec), {"method": prepared.method})
    signals = {
        "contact": found.touched.astype(np.float64),
        "mismatch": found.mismatch,
        "stress_error": found.stress_error,
        "normal_force": found.force[:, :, 2].sum(axis=1, dtype=np.float64),
        "target_force": forces[:, :, 2].sum(axis=1),
    }
    if prepared.method in LEARNED:
        signals["rescued"] = found.rescued.astype(np.float64)
    return Rendered(track, signals, tuple(findings), {"thimble_frames_without_contact": int((~found.touched).sum())})


def forces_at(skin: SkinContact, times: Array) -> Array:
    """Return the virtual touch's forces on the pad nodes at the device's times [N], shape (n, m, 3).

    Values between samples are interpolated linearly.
    """
    return _between(skin, times, skin.force_at, (skin.model.pad_count, 3))


def amounts_at(skin: SkinContact, times: Array) -> Array | None:
    """Return `Stimulus.given` at the device's times [m], shape (n, 3 m); None for linear skin.

    Values between samples are interpolated linearly.
    """
    if skin.amounts is None:
        return None

    def amounts(sample: int) -> Array:
        found = skin.amounts_at(sample)
        assert found is not None
        return found

    return _between(skin, times, amounts, skin.amounts.shape[1:])


def _between(skin: SkinContact, times: Array, at: Callable[[int], Array], shape: tuple[int, ...]) -> Array:
    """Return values at some times, interpolated linearly; samples without contact count as zero."""
    out = np.zeros((len(times), *shape))
    place = np.interp(times, skin.times, np.arange(len(skin.times)))
    before = np.minimum(place.astype(int), len(skin.times) - 1)
    share = place - before
    touched = set(skin.contact.tolist())
    for i, (b, s) in enumerate(zip(before.tolist(), share.tolist(), strict=True)):
        if b in touched:
            out[i] += (1.0 - s) * at(b)
        if s > 0.0 and b + 1 in touched:
            out[i] += s * at(b + 1)
    return out


def findings_of(found: ThimbleSequence, where: str) -> list[Finding]:
    """Return the findings about a matched sequence; `where` names the finger and the device."""
    out, touched = [], int(found.touched.sum())
    limited, steep, rescued = int(found.held_back.sum()), int(found.steep.sum()), int(found.rescued.sum())
    if limited:
        what = f"{'a servo' if found.x.shape[1] == 3 else 'a leg'}'s range or speed holds the match back"
        out.append(Finding("info", "servo-limit", what, where, count=limited))
    if steep:
        out.append(
            Finding(
                "warning" if steep > MAX_STEEP * touched else "info",
                "singular-pose",
                "a better match lies near a singularity, where the platform yields although its servos hold",
                where,
                limit=f"singularity margin >= {MIN_MARGIN:g}",
                remedy="Touch less steeply, or use other link lengths",
                count=steep,
            )
        )
    if rescued:
        share = f"{rescued} of {touched} touched samples"
        out.append(
            Finding(
                "warning" if rescued > DOUBTFUL * touched else "info",
                "rescued",
                f"the surrogate was wrong and the direct search took its place in {share}",
                where,
                limit=f"error of the surrogate <= {100 * MISTRUST:g} % of the target",
                remedy="Adapt a surrogate from more movements, or use the direct method",
                count=rescued,
            )
        )
    rough = int((found.kkt > UNFINISHED).sum())
    if rough:
        out.append(
            Finding(
                "info",
                "at-a-kink",
                "the search stopped where nodes are about to slip or to touch, so the match may not be the best",
                where,
                float(found.kkt.max()),
                f"KKT residual <= {UNFINISHED:g}",
                count=rough,
            )
        )
    astray, without = found.unsettled > 0.0, found.unsettled >= 1.0
    if astray.any():
        rest = found.unsettled[astray & ~without]
        told = [f"remaining error up to {100 * float(rest.max()):.1f} % of the touch"] if rest.size else []
        told += [f"no solution of the law at the pose of {int(without.sum())} samples"] if without.any() else []
        out.append(
            Finding(
                "warning",
                "law-unsettled",
                "the nonlinear law did not converge: the best pose found was kept, and its errors are uncertain",
                where,
                "; ".join(told),
                f"convergence, where poses are searched within {MOST_LOOKS} evaluations of the law",
                remedy="Use more samples per second, or touch less deeply",
                count=int(astray.sum()),
            )
        )
    lost = int((found.touched & ~found.pressing).sum())
    if lost:
        # a device of limited speed always needs a frame or two at the start of a touch
        severity: Severity = "warning" if lost > LATE * touched else "info"
        out.append(Finding(severity, "out-of-reach", "the device does not reach the skin in time", where, count=lost))
    return out
