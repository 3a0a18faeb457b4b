"""SKIPPED: work that the pipeline skips if a scene does not need it.

Skipped work changes no byte of a track, with two exceptions. Forces that still hold are used again, although a new
solution would differ from them within the tolerance of contact. Forces between two solutions are interpolated, and the
benchmark `stride_force_error` measures their error.

A part that skips work counts it in `skipped` under a name of this table. The table has one row per counter. Panels and
summaries show the counts in the words of the table.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple


class Skip(NamedTuple):
    """One kind of work that may be skipped.

    Attributes:
        part: part of the pipeline.
        needs: inputs of the part.
        when: condition under which the work is skipped and counted.
        counted: unit of the count, in words that follow a number.
    """

    part: str
    needs: str
    when: str
    counted: str


SKIPPED: Mapping[str, Skip] = {
    "renderers_not_loaded": Skip(
        "imports", "the module of each kind of device", "no finger wears one", "kinds of device that no finger wears"
    ),
    "fingers_without_skin": Skip(
        "fingers", "a skin", "it is not shown and no device follows it", "fingers whose skin is not simulated"
    ),
    "fingers_unchanged": Skip(
        "fingers",
        "its path, near objects, its devices",
        "all of them are as in an earlier bake",
        "fingers taken from an earlier bake",
    ),
    "pair_samples_far": Skip(
        "objects", "gap of a pad to an object", "their boxes are apart", "pads and objects too far apart, by sample"
    ),
    "skin_pairs_far": Skip(
        "objects", "gaps of a skin to an object", "their boxes are apart", "skins and objects too far apart, by sample"
    ),
    "surfaces_far": Skip(
        "objects", "surface of an object that deforms", "no pad is near", "surfaces of deforming objects not built"
    ),
    "skin_frames_idle": Skip("contact", "forces on the skin", "nothing is near", "samples of a skin with nothing near"),
    "skin_frames_same": Skip(
        "frames",
        "forces on the skin",
        "nothing has moved, or the previous forces still apply",
        "samples of a skin with unchanged forces",
    ),
    "skin_frames_between": Skip(
        "frames",
        "forces on the skin",
        "the finger moves straight on over flat or gently curved surfaces",
        "samples of a skin between two that were solved",
    ),
    "slopes_untouched": Skip(
        "gradient", "slope of a screen's map", "the finger is not on it", "samples of a finger that is on no screen"
    ),
    "effects_off": Skip("effects", "each effect", "its switch or its amplitude is zero", "effects that are off"),
    "bodies_never_touched": Skip(
        "effects", "effects of an object", "it never touches it", "objects that a tactor never touches"
    ),
    "bodies_never_held": Skip(
        "effects", "weight and content", "no finger holds the object", "objects that a tactor never holds"
    ),
    "pin_frames_without_contact": Skip(
        "matching", "forces of pins", "the skin touches nothing", "samples of pins at rest"
    ),
    "thimble_frames_without_contact": Skip(
        "matching", "pose of a disc", "the skin touches nothing", "commands of a thimble at rest"
    ),
    "lookups_without_contact": Skip(
        "matching", "row of a table", "the skin touches nothing", "samples of a platform at rest"
    ),
    "stress_skipped": Skip("stress", "colours of a skin", "it touches nothing", "skins in the view without a touch"),
    "stress_kept": Skip(
        "stress", "colours of a skin", "the stress is unchanged", "skins in the view with unchanged stress"
    ),
    "overlays_kept": Skip(
        "overlays", "contents of a view", "nothing has changed since", "views drawn from stored results"
    ),
}


def told(skipped: Mapping[str, int]) -> Iterator[tuple[str, str]]:
    """Yield part and words of each count, in the order of the table.

    Counts of 0 are left out. Names that are not in the table come last, with the part 'other'.
    """
    for name in sorted(skipped, key=lambda name: ([*SKIPPED].index(name) if name in SKIPPED else len(SKIPPED), name)):
        if skipped[name]:
            row = SKIPPED.get(name)
            words = name.replace("_", " ") if row is None else row.counted
            yield ("other" if row is None else row.part), f"{skipped[name]:,} {words}"
