"""A hand's bones: which of them are a finger's, which one is its last, and where its joints are.

Knows nothing of Blender.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from .._core import Array
from .bone_names import END, FINGERS, Label, is_wrist, labels, side_of

PHALANGES = 3  # of a finger; earlier bones lie in the palm
LIKELY = (0.35, 1.7)  # length of a last phalanx over that of the one before it
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
        source: method that proposed it, 'names' or 'branches'.
        score: of how much it explains. named_fingers: number of fingers whose names agree.
        rivals: other readings of its bones, the best first.
    """

    side: str
    wrist: str
    chains: Mapping[str, Chain] = field(default_factory=dict)
    source: str = "names"
    score: float = 0.0
    named_fingers: int = 0
    rivals: tuple[Hand, ...] = ()

    @property
    def every_bone(self) -> set[str]:
        """Names of the bones of all fingers."""
        return {name for chain in self.chains.values() for name in chain.bones}

    @property
    def readings(self) -> tuple[Hand, ...]:
        """This reading and its rivals, the best first."""
        return (self, *self.rivals)

    @property
    def told(self) -> str:
        """How the fingers were found, in words."""
        return f"By {self.source}; names agree for {self.named_fingers} of {len(self.chains)} fingers"

    def difference(self, other: Hand) -> str:
        """Return which bones carry fingertips in another reading and not in this one, in words."""
        moved = [
            f"{finger} on {chain.last}"
            for finger, chain in other.chains.items()
            if finger not in self.chains or self.chains[finger].last != chain.last
        ]
        gone = [f"no {finger}" for finger in self.chains if finger not in other.chains]
        return ", ".join(moved + gone) or "fingers that end elsewhere on the same bones"

    @property
    def named(self) -> bool:
        """Whether the names of most fingers agree; else the way the bones lie tells which finger is which."""
        return 2 * self.named_fingers > len(self.chains)


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
    if ahead > 0.0 and (bent or not LIKELY[0] * ahead < length < LIKELY[1] * ahead):
        own = _DISTAL * before
    return np.vstack([heads, last.head + own])


def named_hands(bones: Mapping[str, Bone], weighted: Collection[str] = ()) -> list[Hand]:
    """Return a hand for each side and layer of bones with names of fingers, layers with the shortest names first.

    A rig may have several layers of bones: controls, mechanisms, deforming bones.

    Args:
        weighted: names of bones that vertices follow.
    """
    layers: dict[tuple[str, tuple[str, ...]], dict[str, dict[int, str]]] = defaultdict(dict)
    for name, label in labels(bones).items():
        _places(layers[label.side, label.style], label, name, bones)
    hands = []
    for (side, _), layer in sorted(layers.items(), key=lambda item: (len(item[0][1]), len("".join(item[0][1])))):
        chains = {finger: _chain(layer[finger], weighted) for finger in FINGERS if finger in layer}
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


def _chain(places: dict[int, str], weighted: Collection[str]) -> Chain:
    """Return a finger's chain; a bone called an end, and a fourth one, is a marker unless vertices follow it."""
    order = sorted(places)
    chain = ended([places[place] for place in order], weighted, order[-1] == END)
    rest = [places[place] for place in order if places[place] in chain.bones]
    fourth = order[0] == 1 and len(rest) == PHALANGES and rest[-1] == places.get(PHALANGES + 1)
    if not fourth or rest[-1] in weighted:
        return chain
    return Chain(tuple(places[place] for place in order if place <= PHALANGES), rest[-1])


def ended(names: list[str], weighted: Collection[str], marked: bool) -> Chain:
    """Return the chain of bones whose last ones may be no more than markers of the end.

    Args:
        marked: its last name says that it is one, which counts unless vertices follow it.
    """
    count = max((i + 1 for i, name in enumerate(names) if name in weighted), default=0)
    if count < max(min(len(names) - 1, PHALANGES), 1):  # no mesh, or one that only follows the finger's root
        count = max(len(names) - marked, 1)
    return Chain(tuple(names[:count][-PHALANGES:]), names[count] if count < len(names) else "")
