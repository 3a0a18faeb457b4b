"""A small font of our own drawing: 5 by 8 dots a letter, drawn as smooth strokes between neighbouring dots."""

from __future__ import annotations

import unicodedata
from functools import cache

Stroke = tuple[float, float, float, float]
ADVANCE, HEIGHT = 6.0, 7.0  # dots from letter to letter, and from the top of a capital to the base line

# Five columns a letter, the lowest bit at the top, from the space (0x20) on.
_ASCII = bytes.fromhex(
    "0000000000 00005f0000 0007000700 147f147f14 242a7f2a12 2313086462 3649562050 0000070000"
    "001c224100 0041221c00 2a1c7f1c2a 08083e0808 0080600000 0808080808 0000600000 2010080402"
    "3e4141413e 00427f4000 6251494946 2241494936 1814127f10 2745454539 3c4a494930 0171090503"
    "3649494936 064949291e 0000240000 0080640000 0008142241 1414141414 4122140800 0201590906"
    "3e415d594e 7c1211127c 7f49494936 3e41414122 7f4141413e 7f49494941 7f09090901 3e41494979"
    "7f0808087f 00417f4100 304040403f 7f08142241 7f40404040 7f020c027f 7f0408107f 3e4141413e"
    "7f09090906 3e4151215e 7f09192946 2649494932 01017f0101 3f4040403f 0718601807 3f4038403f"
    "6314081463 0708700807 6151494543 007f414100 0204081020 0041417f00 0402010204 4040404040"
    "0001020000 2054545478 7f44444438 3844444428 384444447f 3854545418 08087e0902 18a4a4a47c"
    "7f04040478 00447d4000 4080847d00 7f10284400 00417f4000 7c04780478 7c04040478 3844444438"
    "fc24242418 18242424fc 7c08040408 4854545424 04043f4424 3c4040207c 0c3040300c 3c4030403c"
    "4428102844 1ca0a0a07c 4464544c44 0008364100 00007f0000 0041360800 0402040804"
)
_MORE = {
    "µ": bytes.fromhex("fc4040207c"),
    "²": bytes.fromhex("001d151700"),
    "°": bytes.fromhex("0006090600"),
    "·": bytes.fromhex("0000080000"),
    "–": bytes.fromhex("0808080808"),
    "…": bytes.fromhex("4000400040"),
}
_UNKNOWN = bytes.fromhex("7f4141417f")


def width(text: str) -> float:
    """Return how wide a text is [dots]."""
    return ADVANCE * len(plain(text)) - 1.0 if text else 0.0


def plain(text: str) -> str:
    """Return a text in the letters that this font has: accents go; what is missing will show as a box."""
    letters = []
    for letter in text:
        if letter in _MORE or " " <= letter <= "~":
            letters.append(letter)
            continue
        base = unicodedata.normalize("NFKD", letter)[0]
        letters.append({"μ": "µ"}.get(base, base))
    return "".join(letters)


@cache
def strokes(letter: str) -> tuple[Stroke, ...]:
    """Return a letter's strokes (x0, y0, x1, y1) [dots], y down from the top of a capital; a dot has no length."""
    columns = _columns(letter)
    lit = {(x, y) for x in range(5) for y in range(8) if columns[x] >> y & 1}
    found: list[Stroke] = []
    joined = set()
    for x, y in sorted(lit):
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
            other = (x + dx, y + dy)
            if other not in lit:
                continue
            if dx and dy and ((x + dx, y) in lit or (x, y + dy) in lit):
                continue  # a corner is joined along its two sides
            found.append((x, y, *other))
            joined |= {(x, y), other}
    return (*found, *((x, y, x, y) for x, y in sorted(lit - joined)))


def _columns(letter: str) -> bytes:
    if " " <= letter <= "~":
        start = 5 * (ord(letter) - 0x20)
        return _ASCII[start : start + 5]
    return _MORE.get(letter, _UNKNOWN)
