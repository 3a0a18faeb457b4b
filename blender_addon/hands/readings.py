"""Choose the readings of an armature's bones as hands.

A reading says which chains of bones are the fingers of a hand. Names and branches of bones propose readings, and one
score decides. A finger scores for the number and the likely lengths of its bones, for a last bone with no other bones
beyond it, for a mesh that follows it, for a knuckle half way between wrist and tip, and for agreeing names. The whole
scores for a thumb that opposes the others. This module does not use Blender.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from .._core import Array
from .bone_names import FINGERS, Label, labels
from .branches import branched_hands, opposes
from .skeleton import LIKELY, PHALANGES, Bone, Chain, Hand, ancestors, joints, named_hands, wrist_at

# Parts of a score. A finger has that of its number of bones, and these.
_NAMED = 1.0  # for bones that all have the finger's name
_SKIN = 0.5  # for bones that vertices follow
_KNUCKLE = 0.5  # for a knuckle where a hand has it
_GOES_ON = 0.5  # taken off if bones lie beyond its last bone
_OPPOSED = 0.5  # of a hand, for a thumb that points away from the others; taken off if the thumb does not
_DEFORMS = 0.05  # for bones that deform; of equal layers of a rig, this prefers the one made for meshes
_WHOLE = {1: 0.2, 2: 0.7, PHALANGES: 1.0}  # for the number of bones
_SPREAD = 0.5  # standard deviation of log(palm / finger); in people the two lengths agree to within a fifth
_BEYOND = 0.3  # share of the last bone's length; a bone that begins nearer to its head does not lie beyond it
_RIVAL = 0.5  # share of the best score; readings with a lower score are not offered


def found_hands(bones: Mapping[str, Bone], weighted: Collection[str] = ()) -> list[Hand]:
    """Return the hands of an armature, the best first.

    Each is the best reading of a hand, with the other readings as its rivals.

    Args:
        weighted: names of the bones that vertices follow.
    """
    judge = _Judge(bones, weighted)
    groups: list[list[Hand]] = []
    for hand in _proposed(bones, weighted):
        if not all(np.ptp(joints(bones, chain)[-2:], axis=0).any() for chain in hand.chains.values()):
            continue  # a last phalanx of no length: such chains of markers, as robots have them, are no fingers
        hand = judge.judged(hand)
        group = next((g for g in groups if any(_same(hand, other) for other in g)), None)
        if group is None:
            groups.append(group := [])
        if not any(other.chains == hand.chains for other in group):
            group.append(hand)
    best = [_best(group) for group in groups]
    # Chains from one bone may also be a skirt or a foot. If any hand has names of fingers, only such hands are kept.
    told = [hand for hand in best if hand.named_fingers]
    return sorted(told or best, key=lambda hand: -hand.score)


def _proposed(bones: Mapping[str, Bone], weighted: Collection[str]) -> list[Hand]:
    """Return the readings of all methods.

    Controls beside the bones that move the skin hide how these branch. So they branch once more without such bones,
    which leaves out the bones at ends, too: a reading that differs only in its ends is no other reading.
    """
    found = [*named_hands(bones, weighted), *branched_hands(bones, weighted)]
    kept = {above for name in weighted if name in bones for above in ancestors(bones, name)}
    if len(kept) < len(bones):
        known = [_fingers(hand) for hand in found]
        skinned = branched_hands({name: bone for name, bone in bones.items() if name in kept}, weighted)
        found += [hand for hand in skinned if _fingers(hand) not in known]
    return found


def _fingers(hand: Hand) -> dict[str, tuple[str, ...]]:
    return {finger: chain.bones for finger, chain in hand.chains.items()}


def _same(one: Hand, other: Hand) -> bool:
    """Return whether two readings are of one hand."""
    if one.side and other.side:
        return one.side == other.side
    # Layers of bones, such as controls and deforming bones, may share nothing but the palm.
    return not one.every_bone.isdisjoint(other.every_bone) or one.wrist == other.wrist != ""


def _best(group: list[Hand]) -> Hand:
    order = sorted(group, key=lambda hand: -hand.score)  # equal scores keep the order in which they were proposed
    return replace(order[0], rivals=tuple(hand for hand in order[1:] if hand.score > _RIVAL * order[0].score))


class _Judge:
    """Judge that scores the readings of an armature."""

    def __init__(self, bones: Mapping[str, Bone], weighted: Collection[str]) -> None:
        self.bones, self.weighted = bones, weighted
        self.labels: Mapping[str, Label] = labels(bones)
        self.below: dict[str, list[str]] = defaultdict(list)
        for name in bones:
            for above in ancestors(bones, name)[1:]:
                self.below[above].append(name)

    def judged(self, hand: Hand) -> Hand:
        """Return a hand with its score and the number of its named fingers."""
        lines = {finger: joints(self.bones, chain) for finger, chain in hand.chains.items()}
        wrist = wrist_at(self.bones, hand.wrist, hand.chains.values())
        named = {finger: self._named(finger, chain) for finger, chain in hand.chains.items()}
        score = sum(
            self._finger(finger, chain, lines[finger], wrist) + _NAMED * named[finger]
            for finger, chain in hand.chains.items()
        )
        score += _OPPOSED * _opposed(lines, wrist)
        return replace(hand, score=score, named_fingers=sum(share > 0.5 for share in named.values()))

    def _finger(self, finger: str, chain: Chain, line: Array, wrist: Array | None) -> float:
        steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
        likely = [LIKELY[0] * a <= b <= LIKELY[1] * a for a, b in zip(steps, steps[1:], strict=False)]
        score = _WHOLE[min(len(chain.bones), PHALANGES)] * float(np.mean(likely) if likely else 1.0)
        score += _SKIN * float(np.mean([name in self.weighted for name in chain.bones]))
        score += _DEFORMS * float(np.mean([self.bones[name].deform for name in chain.bones]))
        if any(self._beyond(chain)):
            score -= _GOES_ON
        if wrist is not None and finger != FINGERS[0] and steps.sum() > 0.0:
            palm = float(np.linalg.norm(line[0] - wrist)) / float(steps.sum())
            score += _KNUCKLE * float(np.exp(-0.5 * (np.log(max(palm, 1e-6)) / _SPREAD) ** 2))
        return score

    def _beyond(self, chain: Chain) -> Iterator[bool]:
        """Yield whether each bone below a chain's last bone lies beyond it.

        The bone that marks the end, and the bones below that, are left out.
        """
        last = self.bones[chain.last]
        reach = _BEYOND * float(np.linalg.norm(last.tail - last.head))
        ends = {chain.end, *self.below.get(chain.end, ())}
        for name in self.below.get(chain.last, ()):
            if name not in ends:
                yield float(np.linalg.norm(self.bones[name].head - last.head)) > reach

    def _named(self, finger: str, chain: Chain) -> float:
        """Return the share of a chain's bones that have the finger's name.

        If more bones have the name of another finger, their share is taken off.
        """
        votes = Counter(self.labels[name].finger for name in chain.bones if name in self.labels)
        share = votes[finger] / len(chain.bones)
        others = max((count for other, count in votes.items() if other != finger), default=0) / len(chain.bones)
        return share if share >= others else share - others


def _opposed(lines: Mapping[str, Array], wrist: Array | None) -> float:
    """Return 1 for a thumb that opposes the fingers from the index's side.

    Return -1 for a thumb that does not oppose, and 0 for one on the other side, without a thumb or with too few
    fingers.
    """
    thumb, others = FINGERS[0], [lines[finger] for finger in FINGERS[1:] if finger in lines]
    if thumb not in lines or len(others) < 2:
        return 0.0
    start = np.mean([line[0] for line in lines.values()], axis=0) if wrist is None else wrist
    if not opposes(start, lines[thumb], others):
        return -1.0
    # Its first joint may lie at the wrist, as far from the little finger as from the index. Its middle lies nearer to
    # the index.
    middle = lines[thumb].mean(axis=0)
    near, far = (float(np.linalg.norm(line[0] - middle)) for line in (others[0], others[-1]))
    return 1.0 if near <= far else 0.0
