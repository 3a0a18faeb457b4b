"""Thimble: from the target stimulus of a skin to a disc's joints, by any of the methods, over a whole sequence.

The device is a thimble with its servos, or a platform on six legs that is matched as one.

Target and device are compared by one operator, from forces on the nodes of the finger's mesh to descriptors of stress:
its error is then the same on both sides. Both are solved alike: a touch on points of the smooth skin is followed by a
disc on such points, and the forces of either come as forces on nodes with the same sum and moment.
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


LATE = 0.05  # of the touched samples: if the disc is not there yet in more, a person should know
MAX_STEEP = 0.05  # of the touched samples: the same for touches that are too steep for the mechanism
DOUBTFUL = 0.1  # of the touched samples: a surrogate that is replaced more often is not worth its name
UNFINISHED = 0.05  # a KKT residual above it is worth a finding

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
    noise_floor: float = 0.0,
) -> StressMatcher:
    """Return a matcher that follows targets by a method.

    Args:
        observation_matrix: stress components of forces, or another observation; that of `observation_of` where None.
            Not used by 'force'.
        model: learned model for 'network' and 'ridge'.
        change: largest change of a joint from frame to frame [rad, or m of legs].
        hover: distance kept while nothing is touched [m].
        noise_floor: strength of a target that cannot be told from noise.

    Raises:
        DermisError: an unknown method, a learned method without its model, or servo limits that exclude contact.
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
    if learned is None:  # five fingers of one hand start from the same table
        what = (skin.key, pressed_on(skin), repr(skin.material), device_key(device), repr(friction))
        key = cache_key(version(), *what, observer.matrix.tobytes(), "warm start")
        made = partial(DirectModel, device, contact, observer)
        table = _tables.make(key, lambda: kept_table(skin.cache, key, device, contact, made()))
    return StressMatcher(
        device, contact, observer, learned, change=change, hover=hover, noise_floor=noise_floor, table=table
    )


class Follower:
    """Follows a virtual touch with a thimble, one instant after the other.

    Args:
        matching: the matcher. method: see `METHODS`.
    """

    def __init__(self, matching: StressMatcher, skin: SkinModel, method: str) -> None:
        self.matching, self.skin, self.method = matching, skin, method

    def step(self, force: Array, amounts: Array | None = None) -> ThimbleFrame:
        """Find the device's frame for the touch's forces on the pad nodes [N], shape (m, 3) or (3 m,).

        Args:
            amounts: by how much less than linear skin the pad gives way [m], see `Stimulus.given`, shape (3 m,); from
                the forces where None.

        Raises:
            DermisError: forces that are not finite.
        """
        felt, observer = touch_of(self.skin, force, amounts), self.matching.direct.observer
        assert observer is not None
        target = observer.see(felt)
        if self.method != "geometry" or not target.any():
            return self._told(felt, self.matching.step(target))
        patch = contact_patch(self.skin, felt.force, amounts)
        frame = self.matching.step(target, lambda x, limits: fit_plane(self.matching.device, patch, x, limits))
        return self._told(felt, frame)

    def _told(self, target: Stimulus, frame: ThimbleFrame) -> ThimbleFrame:
        """Return a frame with the error of the whole stress, where there was a touch to match."""
        if frame.minimum is None or frame.felt is None:
            return frame
        return replace(frame, stress_error=stress_error(target, frame.felt))

    def follow(self, forces: Array, amounts: Array | None = None) -> ThimbleSequence:
        """Follow a sequence of touches; forces on the pad nodes [N], shape (n, m, 3) or (n, 3 m).

        Args:
            amounts: as in `step`, shape (n, 3 m).

        Raises:
            DermisError: forces that do not fit the skin or are not finite.
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
        frames = [self.step(force, own) for force, own in zip(forces, given, strict=True)]
        return collect(frames, self.matching.contact, self.method)


def follower(use: ThimbleUse, change: float | None = None) -> Follower:
    """Return the follower of a virtual touch as a thimble is used; `change` as in `matcher`.

    Raises:
        DermisError: servo limits that exclude contact.
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
    """Match a sequence of virtual touches as a thimble is used; forces and amounts as in `Follower.follow`."""
    return follower(use, change).follow(forces, amounts)


def match_stimuli(matching: StressMatcher, stimuli: Array) -> ThimbleSequence:
    """Match a recorded sequence of stimuli in the matcher's own channels, shape (n, k); a row of zeros is no touch."""
    return collect(list(matching.follow(np.asarray(stimuli, np.float64))), matching.contact, "stress")


def render(
    pad_contact: PadContact, scene: TactileScene, finger: int, use: DeviceUse, spec: DeviceSpec, skin: SkinContact
) -> Rendered:
    """Render one finger's thimble, or platform that is matched as one.

    Parameters of the use: see `prepare`.
    Signals: 'contact' (0 or 1), 'mismatch' (in the method's observation), 'stress_error' (of the whole stress,
    relative; on skin that follows a law both are by the law), 'normal_force' and 'target_force' [N]; of a learned
    method also 'rescued' (1 where the direct search took its place).

    Raises:
        DermisError: an unknown method, or a device that cannot touch this finger.

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
    """Forces of the virtual touch at the device's times, linear between samples [N], shape (n, m, 3)."""
    return _between(skin, times, skin.force_at, (skin.model.pad_count, 3))


def amounts_at(skin: SkinContact, times: Array) -> Array | None:
    """Return `Stimulus.given` at the device's times, linear between samples, shape (n, 3 m); None of linear skin."""
    if skin.amounts is None:
        return None

    def amounts(sample: int) -> Array:
        found = skin.amounts_at(sample)
        assert found is not None
        return found

    return _between(skin, times, amounts, skin.amounts.shape[1:])


def _between(skin: SkinContact, times: Array, at: Callable[[int], Array], shape: tuple[int, ...]) -> Array:
    """Return values of samples in contact, linear between samples and zero without contact."""
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
    """Return the findings about a sequence."""
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
                "a better match lies where the platform gives way although its servos are held",
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
                limit=f"a contact within {100 * MISTRUST:g} % of what the surrogate expected",
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
                "the match ends where nodes begin to slip or to touch",
                where,
                float(found.kkt.max()),
                f"KKT residual <= {UNFINISHED:g}",
                count=rough,
            )
        )
    astray = found.unsettled > 0.0
    if astray.any():
        out.append(
            Finding(
                "warning",
                "law-unsettled",
                "the search and the tissue's law did not settle; the pose that leaves least by the law was kept",
                where,
                f"{100 * float(found.unsettled.max()):.1f} % of the touch",
                f"{MOST_LOOKS} looks at the law",
                remedy="Use more samples per second, or touch less deeply",
                count=int(astray.sum()),
            )
        )
    lost = int((found.touched & ~found.pressing).sum())
    if lost:
        # any device with a speed needs a frame or two at first touch
        severity: Severity = "warning" if lost > LATE * touched else "info"
        out.append(Finding(severity, "out-of-reach", "the device does not reach the skin in time", where, count=lost))
    return out
