"""Find the bones and the joints of fingers in a hand.

This module does not use Blender.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from .._core import Array
from .bone_names import END, FINGERS, Label, is_wrist, labels, side_of

PHALANGES = 3  # number of bones of a finger; earlier bones lie in the palm
LIKELY = (0.35, 1.7)  # likely range of the length of a phalanx over the length of the one before it
_STRAIGHT = 0.3  # least cosine between the last two phalanges; below it, an importer has made up the end of the bone
_DISTAL = 0.8  # length of a last phalanx over that of the one before it, if its end is made up
# The frame of a link lies beside its body if it is farther from the body's middle line than this share of the body's
# width. The body must be longer than wide by the factor, and must lie ahead of its frame by this share of its length.
_BESIDE, _LONG, _AHEAD = 0.25, 1.2, 0.25
_ONE_PLACE = 0.02  # share of the distance to the fingertips; bones that begin nearer to one another begin at one place


@dataclass(frozen=True)
class Bone:
    """One bone at rest, in the scene's space and units.

    Attributes:
        parent: name of its parent, '' for none. head, tail: its ends, shape (3,). deform: whether it moves a mesh.
        aside: from its head to the middle line of its finger, shape (3,), if its head lies beside the finger; else
            None.
    """

    name: str
    parent: str
    head: Array
    tail: Array
    deform: bool = True
    aside: Array | None = None


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
        rivals: other readings of its bones, the best first. given: whether a person has given the side.
    """

    side: str
    wrist: str
    chains: Mapping[str, Chain] = field(default_factory=dict)
    source: str = "names"
    score: float = 0.0
    named_fingers: int = 0
    rivals: tuple[Hand, ...] = ()
    given: bool = False

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
        how = {"names": "names", "branches": "how the bones branch"}[self.source]
        return f"Found by {how}; names agree for {self.named_fingers} of {len(self.chains)} fingers"

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
    made up that end, the tip lies straight ahead of the bone before. If the last bone lies beside the finger, all
    joints are moved onto the finger's line with it.
    """
    heads = np.array([bones[name].head for name in chain.bones])
    last = bones[chain.last]
    if last.aside is not None:
        heads = heads + last.aside
    if chain.end and np.linalg.norm(bones[chain.end].head - last.head) > 1e-6 * np.linalg.norm(last.tail - last.head):
        return np.vstack([heads, bones[chain.end].head])
    if len(heads) < 2:
        return np.vstack([heads, last.tail])
    before, own = heads[-1] - heads[-2], last.tail - heads[-1]
    ahead, length = float(np.linalg.norm(before)), float(np.linalg.norm(own))
    bent = float(before @ own) < _STRAIGHT * ahead * length
    if ahead > 0.0 and (bent or not LIKELY[0] * ahead < length < LIKELY[1] * ahead):
        own = _DISTAL * before
    return np.vstack([heads, heads[-1] + own])


def along_body(bone: Bone, triangles: Array) -> Bone:
    """Return a last link with its end by its body, if its frame lies beside the body; else the link as it is.

    A joint's frame may lie anywhere along the joint's axis, so it need not lie in the finger.

    Args:
        triangles: its body, shape (t, 3, 3).
    """
    sides = triangles[:, 1:] - triangles[:, :1]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    if areas.sum() <= 0.0:
        return bone
    axes = _box_axes(triangles, areas / areas.sum())
    points = (triangles.reshape(-1, 3) - bone.head) @ axes
    low, high = points.min(axis=0), points.max(axis=0)
    size, middle = high - low, 0.5 * (low + high)
    if size[0] < _LONG * size[1] or abs(middle[0]) < _AHEAD * size[0]:
        return bone
    if all(abs(middle[1:]) <= _BESIDE * size[1:]):
        return bone
    end = high[0] if middle[0] > 0.0 else low[0]
    aside: Array = axes[:, 1:] @ middle[1:]
    return replace(bone, tail=bone.head + aside + end * axes[:, 0], aside=aside)


def _box_axes(triangles: Array, areas: Array) -> Array:
    """Return the axes of a box round a body, longest side first, as columns of a matrix of shape (3, 3).

    One is the direction in which the body spreads least, and the others give the smallest rectangle across it.

    Args:
        areas: share of each triangle of the surface, shape (t,).
    """
    corners = triangles - areas @ triangles.mean(axis=1)
    sums = corners.sum(axis=1)
    spread = np.einsum("t,tij,tik->jk", areas, corners, corners) + np.einsum("t,tj,tk->jk", areas, sums, sums)
    thin, first, second = np.linalg.eigh(spread)[1].T
    points = corners.reshape(-1, 3) @ np.stack([first, second], axis=1)
    sides: list[tuple[float, float, float]] = []
    for angle in np.radians(np.arange(90.0)):
        c, s = np.cos(angle), np.sin(angle)
        along, across = np.ptp(points @ np.array([[c, -s], [s, c]]), axis=0)
        sides.append((float(along * across), float(angle), float(along - across)))
    _, angle, more = min(sides)
    c, s = np.cos(angle), np.sin(angle)
    one, other = c * first + s * second, c * second - s * first
    return np.stack([one, other, thin] if more >= 0.0 else [other, one, thin], axis=1)


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
