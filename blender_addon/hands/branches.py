"""Propose readings of hands from how bones branch and lie.

Names of bones hardly matter here. This module does not use Blender.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping

import numpy as np

from .._core import Array
from .bone_names import FINGERS, Label, is_foot, labels, side_of
from .skeleton import Bone, Chain, Hand, ancestors, ended, joints, wrist_at

_FEWEST, _MOST = 3, 5  # least and largest number of fingers of a hand
# Share of the distance from a parent's head to its farthest child; a nearer child without children is a helper.
_ALONG = 0.7
_DISTINCT = 0.35  # [rad] least angle between a thumb and the mean of the others in a hand of fewer than five fingers
# [rad] A finger whose angle to the mean of the others is larger by this than any other angle lies across the palm. Only
# a thumb does so, whatever its length.
_ACROSS = 0.7


def branched_hands(bones: Mapping[str, Bone], weighted: Collection[str] = ()) -> list[Hand]:
    """Return readings of hands from how bones branch.

    A palm has three to five chains of at least two bones. It has several readings: the last bones of its chains are
    fingertips or only mark the end, and different chains may be the thumb.

    Args:
        weighted: names of the bones that vertices follow.
    """
    children = _children(bones)
    said = labels(bones)
    palms: dict[str, list[list[str]]] = {}
    for name in bones:
        below = [_bones(bones, children, leaf, name) for leaf in _leaves(children, name)]
        enough = _FEWEST <= len(below) <= _MOST and len(children[name]) > 1
        if enough and all(len(names) > 1 for names in below) and not any(map(is_foot, _names(bones, name, below))):
            palms[name] = below
    # The palm is the bone nearest to the fingers; the bones that carry it have the same fingers.
    near = [palm for palm in palms if not any(_carries(bones, palms, palm, other) for other in palms)]
    return [hand for palm in near for hand in _readings(bones, palm, palms[palm], weighted, said)]


def opposes(start: Array, thumb: Array, others: list[Array]) -> bool:
    """Return whether a finger is a thumb: it points away from the others.

    Its direction is seen from `start`, and fingers are lines of joints, shape (n, 3). A hand of fewer than five fingers
    may have no thumb. There, a thumb points well away and reaches less far than the others, or it lies across the palm,
    as that of a robot does.
    """
    away = _angles_away(start, [thumb, *others])
    beyond = away[0] - max(away[1:])
    if len(others) == _MOST - 1:
        return beyond >= 0.0
    reach = [float(np.linalg.norm(line[-1] - start)) for line in (thumb, *others)]
    short = away[0] >= _DISTINCT and reach[0] < np.median(reach[1:])
    return bool(beyond >= _ACROSS or (short and beyond >= _DISTINCT / 3))


def _angles_away(start: Array, lines: list[Array]) -> list[float]:
    """Return the angle of each finger to the mean of the others [rad].

    Directions are seen from `start`.
    """
    ways = np.array([_unit(line[-1] - start) for line in lines])
    others = (_unit(np.delete(ways, i, axis=0).sum(axis=0)) for i in range(len(ways)))
    return [float(np.arccos(np.clip(way @ other, -1.0, 1.0))) for way, other in zip(ways, others, strict=True)]


def _readings(
    bones: Mapping[str, Bone], palm: str, below: list[list[str]], weighted: Collection[str], said: Mapping[str, Label]
) -> Iterator[Hand]:
    """Yield the readings of a palm's chains, likely ones first."""
    own = (said[name].side if name in said else side_of(name) for names in below for name in names)
    sides = Counter(filter(None, own))
    side = next(iter(dict(sides.most_common(1))), "") or next(filter(None, map(side_of, ancestors(bones, palm))), "")
    for marked in (False, True):
        chains = [ended(names, weighted, marked and len(names) > 2) for names in below]
        for fingers in _assignments(bones, palm, chains, said):
            yield Hand(side, palm, {finger: fingers[finger] for finger in FINGERS if finger in fingers}, "branches")


def _names(bones: Mapping[str, Bone], palm: str, below: list[list[str]]) -> list[str]:
    return [*ancestors(bones, palm), *(name for names in below for name in names)]


def _carries(bones: Mapping[str, Bone], palms: Mapping[str, list[list[str]]], palm: str, other: str) -> bool:
    return palm in ancestors(bones, other)[1:] and len(palms[other]) >= len(palms[palm])


def _children(bones: Mapping[str, Bone]) -> dict[str, list[str]]:
    """Return the children of each bone, without helpers.

    Helpers only twist or bulge with a bone. A helper has no children. It begins where its parent begins, or well before
    another child of its parent.
    """
    children: dict[str, list[str]] = defaultdict(list)
    for bone in bones.values():
        children[bone.parent].append(bone.name)
    found: dict[str, list[str]] = defaultdict(list)
    for parent, names in children.items():
        at = bones[parent].head if parent in bones else None
        away = {name: 0.0 if at is None else float(np.linalg.norm(bones[name].head - at)) for name in names}
        least = _ALONG * max(away.values())
        found[parent] = [name for name in names if at is None or children.get(name) or 0.0 < away[name] >= least]
    return found


def _leaves(children: Mapping[str, list[str]], name: str) -> list[str]:
    below = children.get(name, [])
    return [leaf for child in below for leaf in (_leaves(children, child) or [child])]


def _bones(bones: Mapping[str, Bone], children: Mapping[str, list[str]], leaf: str, palm: str) -> list[str]:
    """Return the bones that end in a leaf, outermost last.

    They begin after the palm, or after the last bone that branches.
    """
    names: list[str] = []
    for name in ancestors(bones, leaf):
        if name == palm or len(children.get(name, [])) > 1:
            break
        names.append(name)
    return names[::-1]


def _assignments(
    bones: Mapping[str, Bone], palm: str, chains: list[Chain], said: Mapping[str, Label]
) -> Iterator[dict[str, Chain]]:
    """Yield possible assignments of chains to fingers.

    The first is by names if all chains have names of different fingers. The others are by position: the thumb is one of
    the two chains that point farthest away, or there is none.
    """
    votes = [Counter(said[name].finger for name in chain.bones if name in said).most_common(1) for chain in chains]
    named = {vote[0][0]: chain for vote, chain in zip(votes, chains, strict=True) if vote}
    if len(named) == len(chains):
        yield named
    lines = [joints(bones, chain) for chain in chains]
    start = wrist_at(bones, palm, chains)
    assert start is not None
    away = _angles_away(start, lines)
    rows: list[tuple[int, ...]] = []  # chains from the thumb to the little finger
    for thumb in sorted(range(len(chains)), key=lambda i: -away[i])[:2]:
        across = _in_line(lines, [i for i in range(len(chains)) if i != thumb])
        rows += [(thumb, *across), (thumb, *across[::-1])]
    for row in rows:
        yield dict(zip(FINGERS, (chains[i] for i in row), strict=False))
    if len(chains) < _MOST:
        across = _in_line(lines, range(len(chains)))
        for row in (across, across[::-1]):
            yield dict(zip(FINGERS[1:], (chains[i] for i in row), strict=False))


def _in_line(lines: list[Array], which: Collection[int]) -> tuple[int, ...]:
    """Return chains in the order of their knuckles across the palm."""
    knuckles = np.array([lines[i][0] for i in which])
    centred = knuckles - knuckles.mean(axis=0)
    across = np.linalg.svd(centred)[2][0]
    return tuple(list(which)[i] for i in np.argsort(centred @ across, kind="stable"))


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else vector
