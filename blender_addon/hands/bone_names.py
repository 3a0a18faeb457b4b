"""Read finger, hand and place along the finger from names of bones.

This module does not use Blender.

A name is cut into words and each word is looked up, so that one table reads `f_index.03.L` and `DEF-f_index.03.L`
(Rigify), `index_03_l` (Unreal, MetaHuman), `mixamorig:LeftHandIndex3` (Mixamo), `finger2-3.L` (MakeHuman),
`Bip01 L Finger12` (3ds Max), `index-finger-phalanx-distal` (WebXR), `J_Bip_L_Index3` (VRM), `lIndex3` (Daz),
`CC_Base_L_Mid3` (Character Creator), `b_l_index3` (Meta), `LeftIndexDistal` (Unity), `indexFingerIntermediateTip`
(visionOS) and `人指３.L` (MMD).
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

from . import FINGERS, LEFT, RIGHT

END = 99  # place of a bone that only marks the end of a finger

_FINGER_WORDS = {
    "thumb": "thumb pollex 親指",
    "index": "index pointer forefinger 人指 人差指",
    "middle": "middle mid 中指",
    "ring": "ring 薬指",
    "little": "little pinky pinkie pinkey 小指",
}
_PLACE_WORDS = {
    0: "metacarpal meta",
    1: "proximal knuckle",
    2: "intermediate medial",
    3: "distal",
    END: "tip end nub null leaf 先",
}
_JOINTS = {"base": 2, "tip": 3}  # the place of a bone that begins at the base or the tip of the intermediate phalanx
_SIDE_WORDS = {LEFT: "l left lh lt 左", RIGHT: "r right rh rt 右"}
_NUMBERED = {"finger", "digit"}  # the number after such a word is that of the finger: finger2-3
_SILENT = {"f", "fingers", "hand", "phalanx", "phalange", "phalanges", "bone", "joint", "jnt", "指", "手"}
_FEET = {"toe", "toes", "foot"}
_WRISTS = {"hand", "wrist", "手首"}

_FINGER_OF = {word: finger for finger, words in _FINGER_WORDS.items() for word in words.split()}
_PLACE_OF = {word: place for place, words in _PLACE_WORDS.items() for word in words.split()}
_SIDE_OF = {word: side for side, words in _SIDE_WORDS.items() for word in words.split()}
_LONG = {w for w in (*_FINGER_OF, *_PLACE_OF, *_SIDE_OF, *_NUMBERED, *_SILENT, *_WRISTS) if len(w) > 2 or w > "~"}
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_A-Za-z]+")
_LINKS = re.compile(r"(?:(?<![A-Za-z])l|(?<![A-Z])L)\d")  # index_L1: the left side, or the first link
_RIGHTS = re.compile(r"(?:(?<![A-Za-z])r|(?<![A-Z])R)\d")


@dataclass(frozen=True)
class Label:
    """Meaning of a bone's name.

    Attributes:
        finger: one of `FINGERS`. side: 'L', 'R', or '' if the name has none.
        place: place along the finger: 0 is a metacarpal, the others count from the palm outwards, and `END` is past
            the last bone.
        style: the rest of the name, such as ('def',), which is the same for the bones of one layer of a rig.
    """

    finger: str
    side: str
    place: int
    style: tuple[str, ...]


def words(name: str) -> list[str]:
    """Return the words and numbers of a bone's name, in lower case.

    A namespace before ':' is left out.

    >>> words("mixamorig:LeftHandIndex3")
    ['left', 'hand', 'index', '3']
    """
    found = (part.lower() for part in _WORD.findall(name.rpartition(":")[2]))
    return [word for part in found for word in _parted(part)]


def side_of(name: str) -> str:
    """Return 'L' or 'R' if a name has exactly one of the sides, else ''."""
    sides = {_SIDE_OF[word] for word in words(name) if word in _SIDE_OF}
    return sides.pop() if len(sides) == 1 else ""


def is_wrist(name: str) -> bool:
    """Return whether a name has a hand or wrist in it, and no finger."""
    return any(w in _WRISTS for w in words(name)) and not any(w in _FINGER_OF for w in words(name))


def is_foot(name: str) -> bool:
    """Return whether a name is of a foot or a toe."""
    return any(w in _FEET for w in words(name))


def labels(names: Iterable[str]) -> dict[str, Label]:
    """Return the labels of those names that name a finger.

    The L in index_L1 is the left side only if another name has an R in such a place. Otherwise it may mean 'link', as
    in the names of robots' parts, and says nothing.
    """
    found: dict[str, Label] = {}
    numbered: dict[tuple[str, ...], dict[str, tuple[int, int, str]]] = defaultdict(dict)
    names = list(names)
    sided = any(_RIGHTS.search(name) for name in names)
    for name in names:
        label, number = _read(name, links=not sided and _LINKS.search(name) is not None)
        if label is not None and number is None:
            found[name] = label
        elif label is not None and number is not None:
            numbered[label.style][name] = (number, label.place, label.side)
    for style, rows in numbered.items():
        count = {number for number, _, _ in rows.values()}
        # Five numbered fingers begin with the thumb, four or fewer with the index finger. The lowest number is the
        # first finger.
        order = FINGERS if max(count) - min(count) >= 4 else FINGERS[1:]
        for name, (number, place, side) in rows.items():
            if number - min(count) < len(order):
                found[name] = Label(order[number - min(count)], side, place, style)
    return found


def _read(name: str, *, links: bool) -> tuple[Label | None, int | None]:
    """Return a name's label, and the finger's number if it has no other name.

    Args:
        links: an L between the finger's name and a number says nothing.
    """
    finger, side, place = "", "", None
    rest: list[str] = []
    numbers: list[str] = []
    counted = False
    own = words(name)
    for before, word in zip(["", *own], own, strict=False):
        if word in _FEET:
            return None, None
        if links and word == "l" and finger:
            continue
        if word in _SIDE_OF and not side:
            side = _SIDE_OF[word]
        elif word in _FINGER_OF and not finger:
            finger = _FINGER_OF[word]
        elif before == "intermediate" and word in _JOINTS:
            place = _JOINTS[word]
        elif word in _PLACE_OF:
            place = _PLACE_OF[word]
        elif word == "middle":  # after the name of a finger this is the middle phalanx
            place = 2
        elif word.isdecimal():
            (numbers if finger or counted else rest).append(word)
        elif word in _NUMBERED:
            counted = True
        elif word not in _SILENT:
            rest.append(word)
    if finger:
        if place is None and numbers:
            place = int(numbers.pop(0))
        elif place == END:
            numbers = []  # in index_03_end, the number is that of the bone before the end
        return Label(finger, side, 1 if place is None else place, (*rest, *numbers)), None
    if not counted or not numbers:
        return None, None
    first = numbers.pop(0)
    if numbers:  # finger2-3: the finger, and its bone
        number, index = int(first), int(numbers.pop(0))
    else:  # Finger0, Finger01, Finger02: the digit of the finger, then that of the bone, which the first bone lacks
        number, index = int(first[0]), int(first[1:] or 0) + 1
    return Label("", side, index if place is None else place, (*rest, *numbers)), number


def _parted(word: str) -> list[str]:
    """Split joined words, such as 'lefthandindex', if all of them are known."""
    if word in _LONG or word.isdecimal():
        return [word]
    for size in range(len(word) - 1, 1 if word < "~" else 0, -1):
        if word[:size] in _LONG:
            rest = _parted(word[size:])
            if all(w in _LONG for w in rest):
                return [word[:size], *rest]
    return [word]


@lru_cache(maxsize=32)
def order(names: tuple[str, ...], fingers: tuple[str, ...]) -> tuple[int, ...]:
    """Return the order in which fingers are shown, as indices of `names`.

    The fingers of a hand come first, from the thumb on, and the others follow in the order of the scene.

    Args:
        names: names of fingers, or of their parts, such as 'Index: thimble'. fingers: names of all fingers of the
            scene.
    """
    said = labels(fingers)

    def rank(i: int) -> tuple[str, int, int, int]:
        whose = names[i] if names[i] in fingers else names[i].partition(": ")[0]
        place = fingers.index(whose) if whose in fingers else len(fingers)
        label = said.get(whose)
        if label is None:
            return ("~", len(FINGERS), place, i)
        return (label.side, FINGERS.index(label.finger), place, i)

    return tuple(sorted(range(len(names)), key=rank))
