"""Discrimination of a scene's touches by an ideal observer.

A finger that touches, lifts and touches again makes several touches. They are compared in pairs: the real touches with
each other, and, for each device and method, the rendered touches with each other.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..contact.skin_contact import SkinContact
from ..errors import DermisError, Finding
from ..pipeline.bake import Output, Progress
from ..pipeline.render import render
from ..presets import Library
from ..scene.tactile_scene import DeviceUse, TactileScene
from ..skin.stimulus import Stimulus
from .afferents import Afferents, moments
from .ideal_observer import Answer, told
from .rendered_forces import rendered_touches
from .wearing import Skipped, finger_index, wearing_all

if TYPE_CHECKING:
    from ..cache import Cache

PAUSE = 0.1  # [s] a longer interval without contact separates two touches
CLOSE = 1e-6  # tolerance for rounding errors of times [s], and of positions between samples [samples]
MOST = 8  # largest number of touches that are compared; these make 28 pairs
# Matching methods that are compared, by the setting that names the method. The method that the finger's own device uses
# is added, so that a learned method is compared if the finger wears a device with it.
METHODS: Mapping[str, tuple[str, ...]] = {
    "thimble_method": ("stress", "force", "geometry"),
    "pin_method": ("DM2", "FM2"),
}
SETTING = {"thimble": "thimble_method", "pin_array": "pin_method"}


@dataclass(frozen=True)
class TouchTime:
    """Start and end of a touch [s], and the scene frame at its start."""

    start: float
    end: float
    frame: float


@dataclass(frozen=True, eq=False)
class ToldRow:
    """Result for one device and method.

    `answers` has one entry for each pair of touches.
    """

    device: str
    title: str
    method: str
    answers: tuple[Answer, ...]


@dataclass(frozen=True, eq=False)
class Told:
    """How well the touches of a finger can be told apart.

    Attributes:
        scene, finger: names of the scene and the finger.
        touches: the touches, in the order of time.
        pairs: indices of the two touches of each pair, from 0.
        real: answers for the real touches, one for each pair.
        rows: answers for the rendered touches, one row for each device and method.
        skipped: devices that were left out, with the reasons.
        findings: problems found while the devices' tracks were played.
    """

    scene: str
    finger: str
    touches: tuple[TouchTime, ...]
    pairs: tuple[tuple[int, int], ...]
    real: tuple[Answer, ...]
    rows: tuple[ToldRow, ...]
    skipped: tuple[Skipped, ...]
    findings: tuple[Finding, ...] = ()


def tell_apart(
    scene: TactileScene, library: Library, finger: str | int = 0, *, cache: Cache | None = None
) -> Generator[Progress, None, Told]:
    """Judge how well touches are told apart through each device.

    Progress is yielded, and a `Told` is returned.

    Args:
        finger: name or index of the finger.
        cache: cache of skins and tables.

    Raises:
        DermisError: there is no such finger, the scene cannot be rendered, no device presses on skin, or the finger
            makes fewer than two touches or more than `MOST`.
    """
    number = finger_index(scene, finger)
    name = scene.fingers[number].name
    worn, skipped = _wearing(scene, library, number)
    bake = yield from render(worn, library, cache=cache)
    skin = bake.skins.get(name)
    touches = () if skin is None else touches_of(skin)
    check_count(name, touches)
    assert skin is not None
    yield Progress("judging", 0, 1 + len(bake.outputs))
    afferents = Afferents.of(skin.model)
    looked = looked_at(skin, touches)
    every = looked.samples
    real = looked.read(afferents, real_states(skin, every))
    pairs = tuple(combinations(range(len(touches)), 2))
    uses = {(use.preset, _method_of(use)): use.parameters for use in worn.fingers[number].devices}
    rows, findings = [], list[Finding]()
    for step, output in enumerate(o for o in bake.outputs if o.finger == name):
        yield Progress("judging", 1 + step, 1 + len(bake.outputs))
        method = str(output.track.meta.get("method", ""))
        parameters = uses.get((output.device, method), uses.get((output.device, ""), {}))
        try:
            states, told_of = _rendered(output, skin, every, parameters)
            read = looked.read(afferents, states)
        except DermisError as error:
            skipped.append(Skipped(output.device, output.track.spec.name, str(error).rstrip(".")))
            continue
        answers = [_answer(read, pair, afferents.noise, real) for pair in pairs]
        rows.append(ToldRow(output.device, output.track.spec.name, method, tuple(answers)))
        findings += told_of
    have = {row.device for row in rows} | {s.device for s in skipped}
    for key in {use.preset: None for use in worn.fingers[number].devices}:
        if key not in have:
            said = [f.what for f in bake.findings if f.code == "device-unavailable" and key in f.what]
            why = next(iter(said), "it could not be rendered")
            skipped.append(Skipped(key, library.device(key).name, why))
    return Told(
        scene.name,
        name,
        touches,
        pairs,
        tuple(_answer(real, pair, afferents.noise, real) for pair in pairs),
        tuple(rows),
        tuple(skipped),
        tuple(findings),
    )


def check_count(finger: str, touches: Sequence[TouchTime]) -> None:
    """Check that a finger makes at least two touches and at most `MOST`.

    Raises:
        DermisError: the number of touches is outside this range.
    """
    if not 2 <= len(touches) <= MOST:
        raise DermisError(
            "touches are compared in pairs",
            where=f"finger '{finger}'",
            value="1 touch" if len(touches) == 1 else f"{len(touches)} touches",
            limit=f"2 to {MOST}",
            remedy="Let the finger touch, lift for a tenth of a second, and touch again",
        )


def touches_of(skin: SkinContact) -> tuple[TouchTime, ...]:
    """Return the touches of a finger.

    Pauses up to `PAUSE` do not divide a touch.
    """
    if not len(skin.contact):
        return ()
    times = skin.times[skin.contact]
    breaks = np.flatnonzero(np.diff(times) > PAUSE)
    starts, ends = np.append(0, breaks + 1), np.append(breaks, len(times) - 1)
    frames = skin.frames[skin.contact]
    return tuple(
        TouchTime(float(times[a]), float(times[b]), float(frames[a]))
        for a, b in zip(starts.tolist(), ends.tolist(), strict=True)
    )


def _wearing(scene: TactileScene, library: Library, number: int) -> tuple[TactileScene, list[Skipped]]:
    """Put all devices that press on skin on a finger, once for each method.

    Returns:
        The scene with these devices, and the devices left out.
    """
    worn, fit, skipped = wearing_all(scene, library, number)
    own = {use.preset: use for use in reversed(worn.fingers[number].devices)}
    devices: list[DeviceUse] = []
    for key in fit:
        spec, use = library.device(key), own[key]
        setting = SETTING.get(spec.kind)
        if not spec.follows_skin:
            skipped.append(Skipped(key, spec.name, "it does not press on the skin, so there is no strain to read"))
        elif setting is None:
            devices.append(use)
        else:
            chosen = str(use.parameters.get(setting, METHODS[setting][0]))
            devices += [
                replace(use, parameters={**use.parameters, setting: method})
                for method in dict.fromkeys((chosen, *METHODS[setting]))
            ]
    if not devices:
        raise DermisError("no device presses on the skin", where=f"finger '{scene.fingers[number].name}'")
    fingers = list(worn.fingers)
    fingers[number] = replace(fingers[number], devices=tuple(devices))
    return replace(worn, fingers=tuple(fingers)), skipped


def _method_of(use: DeviceUse) -> str:
    return str(next((use.parameters[name] for name in METHODS if name in use.parameters), ""))


def looked_at(skin: SkinContact, touches: Sequence[TouchTime]) -> LookedAt:
    """Return the moments at which each touch is evaluated.

    They are the ends and middles of the afferents' frames. All touches get as many frames as the longest touch.
    """
    at = moments(max(touch.end - touch.start for touch in touches))
    first = np.full((len(touches), len(at)), -1, np.intp)
    share = np.zeros(first.shape)
    for k, touch in enumerate(touches):
        times = touch.start + at
        within = times <= touch.end + CLOSE
        place = np.interp(times[within], skin.times, np.arange(len(skin.times)))
        before = np.minimum(np.floor(place + CLOSE).astype(np.intp), len(skin.times) - 2)
        first[k, within], share[k, within] = before, place - before
    return LookedAt(first, share)


@dataclass(frozen=True, eq=False)
class LookedAt:
    """Moments of touches, as positions between samples.

    Attributes:
        first: index of the sample before each moment, shape (touches, moments); -1 after the end of a touch.
        share: position of the moment between that sample (0) and the next (1), shape (touches, moments).
    """

    first: NDArray[np.intp]
    share: Array

    @property
    def samples(self) -> NDArray[np.intp]:
        """Indices of all samples that are needed, rising."""
        before = self.first[self.first >= 0]
        return np.union1d(before, before + 1)

    def read(self, afferents: Afferents, states: Sequence[Stimulus]) -> list[Array]:
        """Return the response to each touch.

        `states` are the states of the skin at `samples`. After the end of a touch the strain is zero.
        """
        strain, within = afferents.strain(states), self.first >= 0
        at = np.searchsorted(self.samples, self.first[within])
        share = self.share[within][:, None]
        whole = np.zeros((*self.first.shape, strain.shape[1]))
        whole[within] = (1.0 - share) * strain[at] + share * strain[at + 1]
        return [afferents.read(touch) for touch in whole]


def real_states(skin: SkinContact, samples: NDArray[np.intp]) -> list[Stimulus]:
    """Return the stimuli of the real touch at some samples.

    They are computed from the nodal forces. The stimuli of devices are computed from nodal forces as well, so that
    both are comparable.
    """
    return [Stimulus(skin.model, skin.force_at(i), given=skin.amounts_at(i)) for i in samples.tolist()]


def _rendered(
    output: Output, skin: SkinContact, samples: NDArray[np.intp], parameters: Mapping[str, Any]
) -> tuple[list[Stimulus], tuple[Finding, ...]]:
    forces, given, findings = rendered_touches(output.track, skin, samples, parameters)
    both = zip(forces, given, strict=True)
    return [Stimulus(skin.model, force, given=amounts) for force, amounts in both], findings


def _answer(read: Sequence[Array], pair: tuple[int, int], noise: float, real: Sequence[Array]) -> Answer:
    first, second = pair
    known = real[first][None], real[second][None]
    return told(read[first][None], read[second][None], noise, known)
