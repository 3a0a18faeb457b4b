"""Thimble: from what a finger's skin shall feel to servo angles, by any of the methods, over a whole sequence."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..cache import cache_key
from ..devices.spec import DeviceSpec
from ..devices.thimble import Thimble, mechanism
from ..errors import DermisError, Finding
from ..scene import DeviceUse, TactileScene, sample_count
from ..skin.model import SkinModel
from ..surrogate.dataset import drain, record
from ..surrogate.forward import DirectModel, ForwardModel
from ..surrogate.learned import Descriptors, descriptors
from ..surrogate.store import contact_of, device_key, load
from ..surrogate.subspace import TOLERANCE
from ..track import CommandTrack
from .baselines import contact_patch, fit_plane, total_force
from .rendered import Rendered
from .stress import StartTable, StressMatcher, ThimbleFrame, start_table

if TYPE_CHECKING:
    from ..contact.skin_touch import SkinTouch
    from ..contact.touch import SampledTouch

Array = NDArray[np.float64]

METHODS = ("stress", "network", "ridge", "force", "geometry")
DESCRIPTOR_MOVEMENTS = 240  # enough for the subspace: more change its size by one component at most
FRICTION = 0.6
UNFINISHED = 0.05  # a KKT residual above it is worth a finding

_known: OrderedDict[tuple[str, str, float, float], Descriptors] = OrderedDict()
_tables: OrderedDict[str, StartTable] = OrderedDict()


@dataclass(frozen=True, eq=False)
class ThimbleSequence:
    """What the device shall do over a sequence, and how well that matches.

    Attributes:
        x: pitch, roll [rad], distance [m], shape (n, 3). angles: of the servos from neutral [rad], shape (n, 3).
        force: of the device on the skin [N], float32, shape (n, m, 3).
        mismatch: |rendered - target| / |target| in the method's own descriptor, 0 without touch, shape (n,).
        kkt: optimality of the search, shape (n,). iterations, evaluations: of it, shape (n,).
        pressing: the disc touches, shape (n,). wanted: the target is a touch, shape (n,).
        held_back: a servo limit was active, shape (n,).
        method: which one.
    """

    x: Array
    angles: Array
    force: NDArray[np.float32]
    mismatch: Array
    kkt: Array
    iterations: NDArray[np.int64]
    evaluations: NDArray[np.int64]
    pressing: NDArray[np.bool_]
    wanted: NDArray[np.bool_]
    held_back: NDArray[np.bool_]
    method: str


def describe(device: Thimble, skin: SkinModel, friction: float, tolerance: float = TOLERANCE) -> Descriptors:
    """Return the descriptors of a device on a skin, kept in memory for the next finger of the same kind."""
    key = (skin.key, device_key(device), friction, tolerance)
    if key not in _known:
        nominal = skin.with_material(alpha=1.0)  # the subspace does not depend on stiffness
        data = drain(record(device, contact_of(device, nominal, friction), DESCRIPTOR_MOVEMENTS))
        _known[key] = descriptors(data, skin.stress_components(), tolerance=tolerance)
        while len(_known) > 8:
            _known.popitem(last=False)
    return _known[key]


def matcher(
    device: Thimble, skin: SkinModel, method: str = "stress", *, friction: float = FRICTION,
    readout: Array | None = None, model: ForwardModel | None = None, change: float | None = None,
) -> StressMatcher:  # fmt: skip
    """Return what follows targets by a method.

    Args:
        readout: stress components of forces; those of `describe` where None. Not used by 'force'.
        model: learned model for 'network' and 'ridge'.
        change: largest change of a servo angle from frame to frame [rad].

    Raises:
        DermisError: an unknown method, a learned method without its model, or servo limits that exclude contact.
    """
    if method not in METHODS:
        raise DermisError("unknown method", where="thimble", value=method, limit=", ".join(METHODS))
    if method in ("network", "ridge") and model is None:
        raise DermisError("the method needs a surrogate", where="thimble", value=method,
                          remedy="Adapt one to this finger, or use the direct method")  # fmt: skip
    contact = contact_of(device, skin, friction)
    if method == "force":
        readout = total_force(skin.pad_count)
    elif readout is None:
        readout = describe(device, skin, friction).readout
    table, learned = None, model if method in ("network", "ridge") else None
    if learned is None:  # five fingers of one hand start from the same table
        key = cache_key(skin.key, repr(skin.material), device_key(device), repr(friction), readout.tobytes())
        table = _tables.get(key)
        if table is None:
            table = _tables[key] = start_table(device, contact, DirectModel(device, contact, readout))
            while len(_tables) > 8:
                _tables.popitem(last=False)
    return StressMatcher(device, contact, readout, learned, change=change, table=table)


def match_sequence(
    device: Thimble, skin: SkinModel, forces: Array, method: str = "stress", *, friction: float = FRICTION,
    readout: Array | None = None, model: ForwardModel | None = None, change: float | None = None,
) -> Generator[tuple[int, int], None, ThimbleSequence]:  # fmt: skip
    """Match a sequence of virtual touches; yields frames done and in all. See `matcher` for the arguments.

    Args:
        forces: of the virtual touch on the pad nodes [N], shape (n, m, 3) or (n, 3 m).

    Raises:
        DermisError: forces that do not fit the skin or are not finite.
    """
    forces = np.asarray(forces, np.float64).reshape(len(forces), -1)
    if forces.shape[1] != 3 * skin.pad_count or not np.isfinite(forces).all():
        raise DermisError("the target's forces do not fit the skin or are not finite", where="thimble",
                          value=forces.shape, limit=f"(n, {3 * skin.pad_count})")  # fmt: skip
    follower = matcher(device, skin, method, friction=friction, readout=readout, model=model, change=change)
    targets = forces @ follower.direct.readout.T
    frames = []
    for i, target in enumerate(targets):
        search = None
        if method == "geometry" and target.any():
            patch = contact_patch(skin, forces[i])

            def search(x: Array, limits: Any, patch: Any = patch) -> Any:
                return fit_plane(device, patch, x, limits)

        frames.append(follower.step(target, search))
        yield i + 1, len(targets)
    return sequence(frames, skin.pad_count, method)


def match_stimuli(follower: StressMatcher, stimuli: Array) -> ThimbleSequence:
    """Match a recorded sequence of stimuli in the matcher's own channels, shape (n, k); a row of zeros is no touch."""
    return sequence(list(follower.follow(np.asarray(stimuli, np.float64))), follower.contact.count, "stress")


def sequence(frames: list[ThimbleFrame], nodes: int, method: str) -> ThimbleSequence:
    """Collect frames."""
    found = [f.minimum for f in frames]
    return ThimbleSequence(
        np.array([f.x for f in frames]), np.array([f.angles for f in frames]),
        np.array([f.solution.spread(nodes) for f in frames], np.float32), np.array([f.mismatch for f in frames]),
        np.array([0.0 if m is None else m.kkt for m in found]),
        np.array([0 if m is None else m.iterations for m in found]),
        np.array([0 if m is None else m.evaluations for m in found]),
        np.array([f.touching for f in frames]), np.array([m is not None for m in found]),
        np.array([m is not None and bool(m.active) for m in found]), method,
    )  # fmt: skip


def finish(steps: Generator[tuple[int, int], None, ThimbleSequence]) -> ThimbleSequence:
    """Run a matching to its end."""
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            found: ThimbleSequence = stop.value
            return found


def render(
    touch: SampledTouch, scene: TactileScene, finger: int, use: DeviceUse, spec: DeviceSpec, skin: SkinTouch
) -> Rendered:
    """Render one finger's thimble.

    Parameters of the use: 'method' (see `METHODS`, default 'stress'); 'surrogate' (path of its files) for 'network' and
    'ridge'. Where a surrogate cannot be used, a finding says why and the direct method takes its place.
    Signals: 'contact' (0 or 1), 'mismatch', 'normal_force' and 'target_force' [N].

    Raises:
        DermisError: an unknown method, or a device that cannot touch this finger.

    Source: [S0] 5
    """
    device, model = mechanism(spec), skin.model
    method = str(use.parameters.get("method", "stress"))
    friction = float(spec.parameters.get("skin_friction", FRICTION))
    where = f"finger '{scene.fingers[finger].name}', {spec.key}"
    findings: list[Finding] = []
    readout, learned = None, None
    if method in ("network", "ridge"):
        try:
            surrogate = load(Path(str(use.parameters.get("surrogate", ""))), model, device, friction)
            readout, learned = surrogate.descriptors.readout, surrogate.model(model, method)
        except DermisError as error:
            findings.append(Finding("warning", "surrogate", f"the direct method was used: {error.what}", where,
                                    error.value, error.limit, error.remedy))  # fmt: skip
            method = "stress"
    times = np.arange(sample_count(scene.fps, scene.frame_range, spec.rate)) / spec.rate
    forces = _forces_at(skin, times)
    found = finish(match_sequence(device, model, forces, method, friction=friction, readout=readout, model=learned,
                                  change=device.servo_speed / spec.rate))  # fmt: skip
    findings += _findings(found, where)
    columns = {f"servo_{i + 1}": found.angles[:, i] for i in range(3)}
    columns.update(zip(("pitch", "roll", "distance"), found.x.T, strict=True))
    unknown = [c.name for c in spec.channels if c.name not in columns]
    if unknown:
        raise DermisError("the thimble has no such channel", where=f"device preset '{spec.key}'",
                          value=", ".join(unknown), limit=", ".join(columns))  # fmt: skip
    track = CommandTrack(spec, times, np.stack([columns[c.name] for c in spec.channels], axis=1))
    signals = {
        "contact": found.wanted.astype(np.float64), "mismatch": found.mismatch,
        "normal_force": found.force[:, :, 2].sum(axis=1, dtype=np.float64), "target_force": forces[:, :, 2].sum(axis=1),
    }  # fmt: skip
    return Rendered(track, signals, tuple(findings), {"thimble frames without touch": int((~found.wanted).sum())})


def _forces_at(skin: SkinTouch, times: Array) -> Array:
    """Forces of the virtual touch at the device's times, linear between samples [N], shape (n, m, 3)."""
    out = np.zeros((len(times), skin.model.pad_count, 3))
    place = np.interp(times, skin.times, np.arange(len(skin.times)))
    before = np.minimum(place.astype(int), len(skin.times) - 1)
    share = place - before
    touched = set(skin.contact.tolist())
    for i, (b, s) in enumerate(zip(before.tolist(), share.tolist(), strict=True)):
        if b in touched:
            out[i] += (1.0 - s) * skin.force_at(b)
        if s > 0.0 and b + 1 in touched:
            out[i] += s * skin.force_at(b + 1)
    return out


def _findings(found: ThimbleSequence, where: str) -> list[Finding]:
    out = []
    limited = int(found.held_back.sum())
    if limited:
        what = "a servo's range or speed holds the match back"
        out.append(Finding("info", "servo-limit", what, where, count=limited))
    rough = int((found.kkt > UNFINISHED).sum())
    if rough:
        out.append(Finding("info", "at-a-kink", "the match ends where nodes begin to slip or to touch", where,
                           float(found.kkt.max()), f"KKT residual <= {UNFINISHED:g}", count=rough))  # fmt: skip
    lost = int((found.wanted & ~found.pressing).sum())
    if lost:
        out.append(Finding("warning", "out-of-reach", "the device does not reach the skin in time", where, count=lost))
    return out


