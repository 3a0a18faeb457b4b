"""By how much contact hangs on what must not matter: touches of solids, each told in other words, or gone otherwise."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from core.experiment import press
from core.skin.stimulus import Stimulus
from core.surface.gap import Surface

from . import remade, retellings, retimed, tolerances
from .bodies import together
from .case import Family, Values, Verdict
from .contacts import skin_of
from .placed import ABOVE, CLEAR, RATE, Touch, draw, draw_without_friction
from .setups import CHANNELS, CONTACT, Record, Series, Setup, compare, computed, stress_reader

Array = NDArray[np.float64]
GROUP = "invariance"
# Two states may both obey the laws of contact: a finding that says so is the only excuse, where ways differ.
SEVERAL = {channel: frozenset({"several-states"}) for channel in CONTACT}
PLACES = 3  # of a slide that are pressed anew
FINE, FINER = 0.05e-3, 0.025e-3  # ways of a sample over which work is summed up, and energy differentiated [m]
WINDOW = 4  # samples over which they are compared
SPOTS = 1e-3  # how far a body is moved for the gradient of energy [m]


def same(channels: dict[str, Series]) -> dict[str, Series]:
    """Return channels as they are."""
    return channels


def unmirrored(touch: Touch, channels: dict[str, Series]) -> dict[str, Series]:
    """Return what a mirrored touch gives, mirrored back; commands belong to devices that are not mirrored."""
    positions = skin_of(str(touch.values["level"])).positions
    image = np.linalg.norm(positions[:, None] * [-1.0, 1.0, 1.0] - positions, axis=2).argmin(axis=1)
    vector, axial = np.array([-1.0, 1.0, 1.0]), np.array([1.0, -1.0, -1.0])
    tensor = np.array([1.0, 1.0, 1.0, 1.0, -1.0, -1.0])  # xx, yy, zz, yz, xz, xy
    change: dict[str, Callable[[Array], Array]] = {
        "force": lambda v: v * vector,
        "torque": lambda v: v * axial,
        "nodal": lambda v: v[:, image] * vector,
        "stress": lambda v: v * tensor,
    }
    return {name: Series(channels[name].times, change[name](channels[name].values)) for name in CONTACT}


@lru_cache(maxsize=64)
def _usual(values: frozenset[tuple[str, object]], rate: float) -> Record:
    return computed(Touch(dict(values)).setup(rate))  # type: ignore[arg-type]


def usual(values: Values, rate: float = RATE) -> Record:
    """Return a touch as it is usually told; families of one seed share it."""
    return _usual(frozenset(values.items()), rate)


# -- what is judged ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Retelling:
    """Judges a touch that is told in other words.

    Attributes:
        name: of its limit. tell: yields the other words. base: what they are told of, where it is not the touch alone.
        back: brings channels to where the first told them. channels: that are compared.
    """

    name: str
    tell: Callable[[Touch, Setup], retellings.Retold]
    base: Callable[[Setup], Setup] | None = None
    back: Callable[[Touch, dict[str, Series]], dict[str, Series]] | None = None
    channels: Collection[str] = CHANNELS

    def __call__(self, values: Values) -> Verdict:
        """Return what changes."""
        touch, verdict = Touch(values), Verdict()
        setup = touch.setup()
        if self.base is None:
            first = usual(values)
        else:
            setup = self.base(setup)
            first = computed(setup)
        for other in self.tell(touch, setup):
            found = computed(other)
            if self.back is not None:
                found = replace(found, channels=self.back(touch, dict(found.channels)))
            compare(verdict, tolerances.INVARIANCE[self.name], first, found, channels=self.channels)
        return verdict


def judge_times(values: Values, name: str, tell: Callable[[Setup], retimed.Retimed]) -> Verdict:
    """Judge the contact of samples that are told at other times; commands follow times, and rightly."""
    verdict, first = Verdict(), usual(values)
    for other, rows in tell(replace(Touch(values).setup(), devices=())):
        same = (rows >= 0).nonzero()[0]
        when = rows[same] / RATE, same / other.rate
        compare(verdict, tolerances.INVARIANCE[name], first, computed(other), when, CONTACT)
    return verdict


def judge_rates(values: Values, name: str, rates: Collection[float], best: float) -> Verdict:
    """Sample a touch at several rates, against the best of them."""
    verdict, reference = Verdict(), usual(values, best)
    for rate in rates:
        compare(verdict, tolerances.INVARIANCE[name], reference, usual(values, rate))
    return verdict


def judge_back(values: Values) -> Verdict:
    """Go there and back without friction: what is felt hangs on the place alone."""
    touch, verdict = Touch(values), Verdict(excuses=SEVERAL)
    way = np.array([[0.0, 0.0, -ABOVE], [0.0, 0.0, touch.depth], [*touch.slide, touch.depth]])
    setup = touch.setup(way=np.vstack([way, way[-2::-1]]))
    felt, half = computed(replace(setup, devices=())), (setup.count - 1) // 2
    there = np.arange(half + 1) / setup.rate
    compare(verdict, tolerances.INVARIANCE["back"], felt, felt, (there, 2.0 * half / setup.rate - there), CONTACT)
    return verdict


def judge_slid(values: Values) -> Verdict:
    """Slide somewhere without friction, and be pressed there anew."""
    touch, verdict = Touch(values), Verdict(excuses=SEVERAL)
    way = np.array([[0.0, 0.0, -ABOVE], [0.0, 0.0, touch.depth], [*touch.slide, touch.depth]])
    setup = replace(touch.setup(way=way), devices=())
    pressed_at = len(touch.offsets(way[:2], RATE)) - 1
    samples = np.unique(np.linspace(pressed_at, setup.count - 1, PLACES + 1).round().astype(int)[1:])
    setup = replace(setup, looked=samples / RATE)
    slid, offsets = computed(setup), touch.offsets(way, RATE)
    for sample in samples.tolist():
        there = offsets[sample]
        anew = replace(touch.setup(way=np.array([[*there[:2], -CLEAR], there])), devices=(), probes=setup.probes)
        last = (anew.count - 1) / RATE
        pressed = computed(replace(anew, looked=np.array([last])))
        when = np.array([sample / RATE]), np.array([last])
        compare(verdict, tolerances.INVARIANCE["slid"], slid, pressed, when, CONTACT)
    return verdict


def judge_press(values: Values) -> Verdict:
    """Press a solid to a depth and along, by `press` and by a bake in the same place."""
    touch, verdict = Touch(values), Verdict()
    way = np.array([[0.0, 0.0, -ABOVE], [0.0, 0.0, touch.depth], [*touch.slide, touch.depth]])
    setup = replace(touch.setup(way=way), devices=())
    times = np.array([len(touch.offsets(way[:2], RATE)) - 1, setup.count - 1]) / RATE
    baked = computed(replace(setup, looked=times))
    vertices, faces = together(*((part.vertices, part.triangles) for part in touch.parts))
    skin, surface = skin_of(str(values["level"])), Surface.build(vertices, faces)
    more = {"friction": float(values["friction"]), "contact": str(values["contact"])}
    for time, slide in zip(times, (np.zeros(2), touch.slide), strict=True):
        felt = press(skin, surface, touch.depth, slide=slide, at=touch.at, turn=touch.turn, **more)  # type: ignore[arg-type]
        one = Record(told_by(felt, float(time), setup.probes), frozenset(f.code for f in felt.findings), baked.contact)
        compare(verdict, tolerances.INVARIANCE["press"], baked, one, (np.array([time]),) * 2, CONTACT)
    return verdict


def told_by(felt: Stimulus, time: float, probes: Array) -> dict[str, Series]:
    """Return the channels of one touch at a time [s]."""
    stress = stress_reader(felt.skin, probes, felt.points is not None)(felt)
    values = {"force": felt.resultant, "torque": felt.moment, "nodal": felt.force, "stress": stress}
    return {name: Series(np.array([time]), np.asarray(value)[None]) for name, value in values.items()}


def judge_work(values: Values) -> Verdict:
    """Go round without friction: in at one place, across, out at another."""
    touch, verdict = Touch(values), Verdict()
    depth, slide = touch.depth, touch.slide
    way = np.array([[0, 0, -CLEAR], [0, 0, depth], [*slide, depth], [*slide, -CLEAR]])
    record, moved = followed(touch, way, FINE)
    felt = record.channels["force"].values
    if felt[[0, -1]].any():  # it is closed in the air
        raise ValueError("the way is not closed: the solid still touches at its end")
    work = np.concatenate([[0.0], np.cumsum(0.5 * np.einsum("ij,ij->i", felt[1:] + felt[:-1], np.diff(moved, axis=0)))])
    verdict.hold("work", abs(float(work[-1])) / max(float(np.abs(work).max()), 1e-300), tolerances.INVARIANCE["work"])
    return verdict


def judge_gradient(values: Values) -> Verdict:
    """Compare force with how energy changes, in a press and across, without friction."""
    touch, verdict = Touch(values), Verdict()
    across = SPOTS * touch.slide / np.linalg.norm(touch.slide)
    way = np.array([[0, 0, -ABOVE], [0, 0, touch.depth], [*across, touch.depth]])
    record, moved = followed(touch, way, FINER)
    felt, energy = record.channels["force"].values, energies(record)
    steps = np.diff(moved, axis=0)
    work = np.concatenate([[0.0], np.cumsum(0.5 * np.einsum("ij,ij->i", felt[1:] + felt[:-1], steps))])
    far = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    gone = far[WINDOW:] - far[:-WINDOW]
    off = np.abs((work[WINDOW:] - work[:-WINDOW]) - (energy[WINDOW:] - energy[:-WINDOW])) / gone
    peak = float(np.linalg.norm(felt, axis=1).max())
    verdict.hold("gradient", float(off.max()) / max(peak, 1e-300), tolerances.INVARIANCE["gradient"])
    return verdict


def followed(touch: Touch, way: Array, step: float) -> tuple[Record, Array]:
    """Return what is felt along a way of short steps, each sample solved, and where the solid is [m], shape (n, 3)."""
    setup = touch.setup(way=way, speed=step * RATE)
    every = {**setup.parameters, "solved_at": "samples"}
    return computed(replace(setup, devices=(), looked=np.zeros(0), parameters=every)), touch.offsets(
        way, RATE, step * RATE
    )


def energies(record: Record) -> Array:
    """Return the elastic energy at each sample [J], shape (n,); of skin that is linear."""
    contact, out = record.contact, np.zeros(len(record.contact.times))
    for sample in contact.contact.tolist():
        points = contact.points_at(sample)
        if points is None:
            out[sample] = contact.model.energy(contact.force_at(sample))
        else:
            moved = points.surface.apply(points.cells, points.force)
            out[sample] = 0.5 * float(np.einsum("ij,ij->", moved, points.force))
    return out


def family(name: str, what: str, judge: Callable[[Values], Verdict], friction: bool = True) -> Family:
    """Return a family; all of them draw the same touches, with friction or without."""
    return Family(f"{GROUP}_{name}", what, draw if friction else draw_without_friction, judge, group=GROUP)


def retold(name: str, what: str, tell: Callable[[Touch, Setup], retellings.Retold], **more: object) -> Family:
    """Return the family of a touch told in other words."""
    return family(name, what, Retelling(name, tell, **more))  # type: ignore[arg-type]


FAMILIES = (
    retold("untouched", "one more body beside, above or behind, which is not touched", retellings.untouched),
    retold("broad_phase", "every body handed to the solver", retellings.broad_phase, base=retellings.beside),
    retold("order", "bodies and fingers in another order", retellings.order, base=retellings.twinned),
    retold("names", "bodies and fingers of other names", retellings.names),
    retold("start", "iterations that start from nothing, the last forces or random ones", retellings.start),
    retold("chunks", "samples handed over in parts", retellings.chunks),
    retold("strides", "every sample solved", retellings.strides),
    retold("caches", "baked again, with caches that are empty or full", retellings.caches),
    retold("processes", "fingers spread over processes", retellings.processes, base=retellings.with_finger),
    retold("triangles", "a surface cut into other triangles", retellings.triangles),
    retold("welded", "triangles that share no corners", retellings.welded),
    retold("cracked", "the same, a nanometre apart", retellings.cracked),
    retold("shifted", "the solid shifted by 1e-9 to 1e-6 m", retellings.shifted),
    retold("stranger", "another material of a body that is not touched", retellings.stranger, base=retellings.beside),
    retold("scaled", "scales in the object's matrix, their inverses in the mesh", remade.scaled),
    retold("litter", "loose corners, faces without area, faces and bodies twice", remade.litter),
    retold("seam", "the solid in two that meet where it is touched", remade.seam),
    family("pace", "slower, faster, with stops", partial(judge_times, name="pace", tell=retimed.pace)),
    family("span", "a scene that begins earlier or ends sooner", partial(judge_times, name="span", tell=retimed.span)),
    retold(
        "mirrored",
        "the scene mirrored in the finger's middle plane",
        retellings.mirrored,
        back=unmirrored,
        channels=CONTACT,
    ),
    retold("turned", "the scene turned, carried away, or moved in place of the finger", retellings.turned_about),
    family("rate", "240 against 480 samples a second", partial(judge_rates, name="rate", rates=(240.0,), best=480.0)),
    family(
        "rates",
        "60, 120 and 240 samples a second against 960",
        partial(judge_rates, name="rates", rates=(60.0, 120.0, 240.0), best=960.0),
    ),
    family("back", "there and back, without friction", judge_back, friction=False),
    family("slid", "slid to a place against pressed there, without friction", judge_slid, friction=False),
    family("press", "`press` against a bake in the same place", judge_press),
    family("work", "work over a closed way, without friction", judge_work, friction=False),
    family("gradient", "force against how energy changes, without friction", judge_gradient, friction=False),
)
MEASURED = (*CHANNELS, "work", "gradient")
