"""Find the bones and the joints of fingers in a hand.

This module does not use Blender.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from .._core import Array
from .bone_names import END, FINGERS, Label, is_wrist, labels, side_of

PHALANGES = 3  # number of bones of a finger; earlier bones lie in the palm
LIKELY = (0.35, 1.7)  # likely range of the length of a phalanx over the length of the one before it
_STRAIGHT = 0.3  # least cosine between the last two phalanges; below it, an importer has made up the end of the bone
_DISTAL = 0.8  # length of a last phalanx over that of the one before it, if its end is made up
_ONE_PLACE = 0.02  # share of the distance to the fingertips; bones that begin nearer to one another begin at one place


@dataclass(frozen=True)
class Bone:
    """One bone at rest, in the scene's space and units.

    Attributes:
        parent: name of its parent, '' for none. head, tail: its ends, shape (3,). deform: whether it moves a mesh.
    """

    name: str
    parent: str
    head: Array
    tail: Array
    deform: bool = True


@dataclass(frozen=True)
class Chain:
    """The bones of one finger from the palm outwards.

    `end` is the name of the bone that marks the end of the finger, '' without one.
    """

    bones: tuple[str, ...]
    end: str = ""

    @property
    def last(self) -> str:
        """The bone that carries the fingertip."""
        return self.bones[-1]


@dataclass(frozen=True)
class Hand:
    """A reading of bones as a hand.

    Attributes:
        side: 'L', 'R', or '' if unknown. wrist: bone of its palm, '' without one. chains: the bones of each finger.
        source: method that proposed it, 'names' or 'branches'.
        score: score of the reading; the best reading has the highest. named_fingers: number of fingers whose bones are
            named as that finger.
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
        """Text on how the fingers were found."""
        return f"By {self.source}; names agree for {self.named_fingers} of {len(self.chains)} fingers"

    def difference(self, other: Hand) -> str:
        """Return a text on the fingertips that another reading places differently."""
        moved = [
            f"{finger} on {chain.last}"
            for finger, chain in other.chains.items()
            if finger not in self.chains or self.chains[finger].last != chain.last
        ]
        gone = [f"no {finger}" for finger in self.chains if finger not in other.chains]
        return ", ".join(moved + gone) or "fingers that end elsewhere on the same bones"

    @property
    def named(self) -> bool:
        """Whether most fingers are known by name, not only by their position."""
        return 2 * self.named_fingers > len(self.chains)


def ancestors(bones: Mapping[str, Bone], name: str) -> list[str]:
    """Return a bone and its parents, outermost last."""
    found: list[str] = []
    while name in bones and name not in found:
        found.append(name)
        name = bones[name].parent
    return found


def joints(bones: Mapping[str, Bone], chain: Chain) -> Array:
    """Return a finger's joints at rest, from the knuckle to the tip.

    Their shape is (n, 3). The tip is at the marker of the end, else at the end of the last bone. If an importer has
    made up that end, the tip lies straight ahead of the bone before.
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


def wrist_at(bones: Mapping[str, Bone], palm: str, chains: Collection[Chain]) -> Array | None:
    """Return where the wrist of some fingers is, shape (3,); None without a palm's bone.

    It is the head of the palm's bone. If all bones on it that lead to the fingers begin at one place, it is that place:
    then the palm's bone may be a forearm, which begins at the elbow.
    """
    if not palm:
        return None
    firsts: set[str] = set()
    for chain in chains:
        above = ancestors(bones, chain.bones[0])
        if palm not in above[1:]:
            return bones[palm].head
        firsts.add(above[above.index(palm) - 1])
    starts = np.array([bones[name].head for name in sorted(firsts)])
    start: Array = starts.mean(axis=0)
    reach = np.mean([np.linalg.norm(bones[chain.last].head - start) for chain in chains])
    together = len(firsts) > 1 and np.linalg.norm(starts - start, axis=1).max() < _ONE_PLACE * reach
    return start if together else bones[palm].head


def named_hands(bones: Mapping[str, Bone], weighted: Collection[str] = ()) -> list[Hand]:
    """Return hands by the names of bones, one for each side and layer.

    A rig may have several layers of bones, such as controls, mechanisms and deforming bones. Layers with the shortest
    names come first.

    Args:
        weighted: names of the bones that vertices follow.
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
    """Return the nearest bone that carries all of `firsts`.

    If there is none, return a bone named as a hand or wrist of the side, else ''.
    """
    above = [ancestors(bones, name)[1:] for name in firsts]
    common = [name for name in above[0] if all(name in others for others in above)] if len(above) > 1 else []
    if common:
        return common[0]
    return next((name for name in bones if is_wrist(name) and side_of(name) == side), "")


def _places(fingers: dict[str, dict[int, str]], label: Label, name: str, bones: Mapping[str, Bone]) -> None:
    """Put a bone at its place along its finger.

    Of two bones for one place, a deforming one is preferred.
    """
    there = fingers.setdefault(label.finger, {})
    if label.place not in there or bones[name].deform > bones[there[label.place]].deform:
        there[label.place] = name


def _chain(places: dict[int, str], weighted: Collection[str]) -> Chain:
    """Return a finger's chain from the places of its bones.

    A bone that is named an end, and a fourth bone, only mark the end of the finger unless vertices follow them.
    """
    order = sorted(places)
    chain = ended([places[place] for place in order], weighted, order[-1] == END)
    rest = [places[place] for place in order if places[place] in chain.bones]
    fourth = order[0] == 1 and len(rest) == PHALANGES and rest[-1] == places.get(PHALANGES + 1)
    if not fourth or rest[-1] in weighted:
        return chain
    return Chain(tuple(places[place] for place in order if place <= PHALANGES), rest[-1])


def ended(names: list[str], weighted: Collection[str], marked: bool) -> Chain:
    """Return the chain of bones, of which the last may only mark the end.

    Args:
        marked: whether the last bone is named a marker; its name does not count if vertices follow it.
    """
    count = max((i + 1 for i, name in enumerate(names) if name in weighted), default=0)
    if count < max(min(len(names) - 1, PHALANGES), 1):  # no mesh, or one that only follows the finger's root
        count = max(len(names) - marked, 1)
    return Chain(tuple(names[:count][-PHALANGES:]), names[count] if count < len(names) else "")
