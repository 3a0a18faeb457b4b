"""How much of what the stress suite draws is excused before it is judged: what rows of `known.py` cover."""

from __future__ import annotations

from . import Result, benchmark

CASES, SEED = 120, 5_000_000  # of each family with a row; not those of the sample that unit tests read


@benchmark("known_covers", limit=0.1)
def known_covers() -> Result:
    """The largest share of a family's cases, drawn and solved, that meets the condition of one of its rows."""
    from tests.stress.families import FAMILIES
    from tests.stress.known import KNOWN
    from tests.stress.run import run

    names = {row.family for row in KNOWN}
    families = [family for family in FAMILIES if family.name in names]
    tallies, _, _ = run(families, SEED, runs=CASES, simplify=False, again=False)
    shares = {row.name: tallies[row.family].covered(row) / tallies[row.family].counts["tried"] for row in KNOWN}
    ranked = sorted(shares.items(), key=lambda item: -item[1])
    return Result("known_covers", ranked[0][1] if ranked else 0.0, "1", None, dict(ranked))
