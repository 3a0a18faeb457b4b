"""Hands whose bones have names that say nothing, found by how their bones branch and lie. Knows nothing of Blender."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping

import numpy as np

from .._core import Array
from .bone_names import FINGERS, side_of
from .skeleton import Bone, Chain, Hand, ancestors, ended, joints

_FEWEST, _MOST = 3, 5  # fingers of a hand
_DISTINCT = 0.35  # [rad] how far a thumb points away from the fingers' mean, more than any of them does


def branched_hands(bones: Mapping[str, Bone], weighted: Collection[str] = ()) -> list[Hand]:
    """Return the hands among bones: a palm from which three to five chains of two bones and more go out.

    Args:
        weighted: names of bones that vertices follow.
    """
    children: dict[str, list[str]] = defaultdict(list)
    for bone in bones.values():
        children[bone.parent].append(bone.name)
    found: list[Hand] = []
    for name in bones:
        below = [_chain(bones, children, leaf, name, weighted) for leaf in _leaves(children, name)]
        chains = [chain for chain in below if len(chain.bones) > 1]
        if not _FEWEST <= len(chains) <= _MOST or len(chains) != len(below) or len(children[name]) < 2:
            continue
        side = next((s for s in map(side_of, ancestors(bones, name)) if s), "")
        found.append(Hand(side, name, _fingers(bones, bones[name].head, chains), named=False))
    # The palm is the bone nearest to the fingers; who carries it has the same ones.
    return [hand for hand in found if not any(_carries(bones, hand, other) for other in found)]


def _carries(bones: Mapping[str, Bone], hand: Hand, other: Hand) -> bool:
    return hand.wrist in ancestors(bones, other.wrist)[1:] and len(other.chains) >= len(hand.chains)


def _leaves(children: Mapping[str, list[str]], name: str) -> list[str]:
    below = children.get(name, [])
    return [leaf for child in below for leaf in (_leaves(children, child) or [child])]


def _chain(
    bones: Mapping[str, Bone], children: Mapping[str, list[str]], leaf: str, palm: str, weighted: Collection[str]
) -> Chain:
    """Return the bones from a leaf inwards, as far as nothing else hangs on them."""
    names = []
    for name in ancestors(bones, leaf):
        if name == palm or len(children.get(name, [])) > 1:
            break
        names.append(name)
    return ended(names[::-1], weighted, marked=len(names) > 4)


def _fingers(bones: Mapping[str, Bone], palm: Array, chains: list[Chain]) -> dict[str, Chain]:
    """Return which chain is which finger: a thumb points away from the others, its neighbour is the index finger."""
    lines = [joints(bones, chain) for chain in chains]
    ways = np.array([_unit(line[-1] - palm) for line in lines])
    away = [
        float(np.arccos(np.clip(ways[i] @ _unit(np.delete(ways, i, axis=0).sum(axis=0)), -1.0, 1.0)))
        for i in range(len(chains))
    ]
    thumb = int(np.argmax(away))
    others = [i for i in range(len(chains)) if i != thumb]
    reach = [float(np.linalg.norm(line[-1] - palm)) for line in lines]
    beyond = away[thumb] - max(away[i] for i in others)
    short = reach[thumb] < np.median([reach[i] for i in others])
    if len(chains) < _MOST and (beyond < _DISTINCT / 3 or away[thumb] < _DISTINCT or not short):
        return dict(zip(FINGERS[1:], (chains[i] for i in _in_line(lines, range(len(chains)))), strict=False))
    order = _in_line(lines, others)
    start = lines[thumb][0]
    if np.linalg.norm(lines[order[0]][0] - start) > np.linalg.norm(lines[order[-1]][0] - start):
        order = order[::-1]
    return {FINGERS[0]: chains[thumb], **dict(zip(FINGERS[1:], (chains[i] for i in order), strict=False))}


def _in_line(lines: list[Array], which: Collection[int]) -> list[int]:
    """Return chains in their order across the palm, by their knuckles."""
    knuckles = np.array([lines[i][0] for i in which])
    centred = knuckles - knuckles.mean(axis=0)
    across = np.linalg.svd(centred)[2][0]
    return [list(which)[i] for i in np.argsort(centred @ across, kind="stable")]


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else vector
