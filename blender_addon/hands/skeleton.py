"""A hand's bones: which of them are a finger's, which one is its last, and where its joints are.

Bones are found by their names, or where those say nothing by how they branch. Knows nothing of Blender.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from .._core import Array
from .bone_names import END, FINGERS, Label, is_wrist, labels, side_of

_PHALANGES = 3  # of a finger; what comes before them lies in the palm
_LIKELY = (0.35, 1.7)  # length of a last phalanx over that of the one before it
_STRAIGHT = 0.3  # cosine between the two: beyond it, an importer has made up where the bone ends
_DISTAL = 0.8  # length of a last phalanx over that of the one before it, where nothing says


@dataclass(frozen=True)
class Bone:
    """One bone at rest, in the scene's space and units.

    Attributes:
        parent: its name, '' for none. head, tail: shape (3,). deform: it moves a mesh.
    """

    name: str
    parent: str
    head: Array
    tail: Array
    deform: bool = True


@dataclass(frozen=True)
class Chain:
    """The bones of one finger from the palm outwards, and what marks its end, '' for nothing."""

    bones: tuple[str, ...]
    end: str = ""

    @property
    def last(self) -> str:
        """The bone that carries the fingertip."""
        return self.bones[-1]


@dataclass(frozen=True)
class Hand:
    """A hand: its side ('L', 'R', '' unknown), the bone of its palm ('' none), and its fingers' chains.

    Attributes:
        named: names say which finger is which; else the way the bones lie does.
    """

    side: str
    wrist: str
    chains: Mapping[str, Chain] = field(default_factory=dict)
    named: bool = True


def ancestors(bones: Mapping[str, Bone], name: str) -> list[str]:
    """Return a bone and its parents, outermost last."""
    found: list[str] = []
    while name in bones and name not in found:
        found.append(name)
        name = bones[name].parent
    return found


def joints(bones: Mapping[str, Bone], chain: Chain) -> Array:
    """Return a finger's joints from the knuckle to the tip, at rest, shape (n, 3).

    The tip is where a marker says, else where the last bone ends, unless an importer made that up: then it lies
    straight ahead.
    """
    heads = np.array([bones[name].head for name in chain.bones])
    last = bones[chain.last]
    if chain.end and np.linalg.norm(bones[chain.end].head - last.head) > 1e-6 * np.linalg.norm(last.tail - last.head):
        return np.vstack([heads, bones[chain.end].head])
    if len(heads) < 2:
        return np.vstack([heads, last.tail])
    before, own = heads[-1] - heads[-2], last.tail - last.head
    ahead, length = float(np.linalg.norm(before)), float(np.linalg.norm(own))
    bent = float(before @ own) < _STRAIGHT * ahead * length
    if ahead > 0.0 and (bent or not _LIKELY[0] * ahead < length < _LIKELY[1] * ahead):
        own = _DISTAL * before
    return np.vstack([heads, last.head + own])


def named_hands(bones: Mapping[str, Bone], weighted: Collection[str] = ()) -> list[Hand]:
    """Return the hands whose fingers are named, one a side.

    A rig may have several layers of bones: controls, mechanisms, what deforms. The layer with most fingers is taken;
    of equal ones the layer that moves a mesh.

    Args:
        weighted: names of bones that vertices follow.
    """
    layers: dict[str, dict[tuple[str, ...], dict[str, dict[int, str]]]] = defaultdict(dict)
    for name, label in labels(bones).items():
        _places(layers[label.side].setdefault(label.style, {}), label, name, bones)
    hands = []
    for side, styles in sorted(layers.items()):
        best = max(styles.items(), key=lambda item: _rank(item[0], item[1], bones, weighted))[1]
        chains = {finger: _chain(best[finger], weighted) for finger in FINGERS if finger in best}
        if len(chains) > 1 or any(len(chain.bones) > 1 for chain in chains.values()):
            wrist = wrist_of(bones, [chain.bones[0] for chain in chains.values()], side)
            hands.append(Hand(side or side_of(wrist), wrist, chains))
    return hands


def wrist_of(bones: Mapping[str, Bone], firsts: Iterable[str], side: str) -> str:
    """Return the bone that carries all these, else one named a hand or wrist of a side, else ''."""
    above = [ancestors(bones, name)[1:] for name in firsts]
    common = [name for name in above[0] if all(name in others for others in above)] if len(above) > 1 else []
    if common:
        return common[0]
    return next((name for name in bones if is_wrist(name) and side_of(name) == side), "")


def _places(fingers: dict[str, dict[int, str]], label: Label, name: str, bones: Mapping[str, Bone]) -> None:
    """Put a bone in its place along its finger; of two with one place, the one that deforms."""
    there = fingers.setdefault(label.finger, {})
    if label.place not in there or bones[name].deform > bones[there[label.place]].deform:
        there[label.place] = name


def _rank(
    style: tuple[str, ...], fingers: dict[str, dict[int, str]], bones: Mapping[str, Bone], weighted: Collection[str]
) -> tuple[float, ...]:
    names = [name for places in fingers.values() for name in places.values()]
    whole = sum(len(places) > 1 for places in fingers.values())
    moved = sum(name in weighted for name in names)
    return whole, moved, sum(bones[name].deform for name in names), -len(style), -len("".join(style))


def _chain(places: dict[int, str], weighted: Collection[str]) -> Chain:
    """Return a finger's chain; a bone called an end, and a fourth one, is a marker unless vertices follow it."""
    order = sorted(places)
    chain = ended([places[place] for place in order], weighted, order[-1] == END)
    rest = [places[place] for place in order if places[place] in chain.bones]
    fourth = order[0] == 1 and len(rest) == _PHALANGES and rest[-1] == places.get(_PHALANGES + 1)
    if not fourth or rest[-1] in weighted:
        return chain
    return Chain(tuple(places[place] for place in order if place <= _PHALANGES), rest[-1])


def ended(names: list[str], weighted: Collection[str], marked: bool) -> Chain:
    """Return the chain of bones whose last one may be no more than a marker of the end.

    Args:
        marked: its name says that it is one, which counts unless vertices follow it.
    """
    moves_none = names[-1] not in weighted
    end = len(names) > 1 and moves_none and (marked or names[-2] in weighted)
    own = names[:-1] if end else names
    return Chain(tuple(own[-_PHALANGES:]), names[-1] if end else "")
