"""Store and read the skins of a result.

A stored skin has contact forces in single precision, and the parameters of its model. Forces on points of the smooth
skin are kept beside those on nodes, as cells of its tree. If the table of the smooth skin is gone, only those on nodes
are read. Skin that follows its tissue's law is read with the state that its contact stored. Earlier versions used a
series of that law: their forces are read unchanged, and the displacement by these forces follows the law.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from .. import reporting
from .._core import DermisError, Finding, core
from ..devices import skin_models

PREFIX = "skin_"  # prefix of the names of skins' arrays
EARLIER = "earlier-tissue"  # code of the finding on tissue of earlier versions
SMALL = ("_times", "_normal_force")  # ends of the names of the arrays that are read with the tracks


def pack(
    skins: Mapping[str, Any], made_of: Mapping[str, Mapping[str, Any]], arrays: dict[str, Any]
) -> list[dict[str, Any]]:
    """Add the arrays of a bake's skins to `arrays`; return header entries."""
    entries = []
    for i, (finger, touch) in enumerate(skins.items()):
        if finger not in made_of:
            continue
        own = core.contact.skin_arrays.arrays_of(touch)
        arrays.update({f"{PREFIX}{i}_{name}": array for name, array in own.items()})
        entries.append(
            {
                "finger": finger,
                "number": i,
                **made_of[finger],
                "tissue": touch.model.tissue,
                "law": touch.model.follows_law,
                "nodes": touch.model.pad_count,
                "findings": [f.as_dict() for f in touch.findings],
                "skipped": dict(touch.skipped),
            }
        )
    return entries


def at_once(name: str) -> bool:
    """Return whether an array of a stored result is read with its tracks."""
    return not name.startswith(PREFIX) or name.endswith(SMALL)


class StoredSkins(Mapping[str, Any]):
    """The skins of a stored result, read when one is first needed.

    Reading may have to make their models. A skin that cannot be read, or that has other nodes in this version, is
    missing from then on, and a finding gives the reason.

    Args:
        path: path of the stored result. entries: entries of the skins in its header. file: its small arrays.

    Attributes:
        forces: times [s] and normal forces [N] of every skin by finger, which need no model.
    """

    def __init__(self, path: Path, entries: Sequence[Mapping[str, Any]], file: Mapping[str, Any]) -> None:
        self._path, self._entries = path, {str(entry["finger"]): entry for entry in entries}
        self._read: dict[str, Any] | None = None
        self.forces: dict[str, tuple[Any, Any]] = {
            finger: (file[f"{PREFIX}{e['number']}_times"], file[f"{PREFIX}{e['number']}_normal_force"])
            for finger, e in self._entries.items()
        }

    def __getitem__(self, finger: str) -> Any:
        if finger not in self._entries:
            raise KeyError(finger)
        return self._skins()[finger]

    def __iter__(self) -> Iterator[str]:
        return iter(self._skins())

    def __len__(self) -> int:
        return len(self._entries if self._read is None else self._read)

    def _skins(self) -> dict[str, Any]:
        if self._read is None:
            self._read, told = {}, []
            for finger, entry in self._entries.items():
                try:
                    self._read[finger] = _unpacked(self._path, entry)
                    if _by_series(entry):
                        told.append(_as_it_was(finger))
                except DermisError as error:
                    told.append(error.as_finding())
            if told:
                reporting.show((*reporting.findings(), *told), reporting.source())
        return self._read


def forces_of(skins: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Return times [s] and normal forces [N] of a bake's skins, by finger.

    No stored skin is read for this.
    """
    forces: dict[str, tuple[Any, Any]] | None = getattr(skins, "forces", None)
    if forces is not None:
        return forces
    return {finger: (touch.times, touch.normal_force) for finger, touch in skins.items()}


def _unpacked(path: Path, entry: Mapping[str, Any]) -> Any:
    """Return one skin of a stored result.

    Raises:
        DermisError: the file is gone or damaged, or this version makes the skin with other nodes, to which the forces
            do not belong.
    """
    i, finger = int(entry["number"]), str(entry["finger"])
    tissue, where = str(entry.get("tissue", "linear")), f"finger '{finger}', skin"
    model: Any = skin_models.get(entry["skin"], entry["level"], tissue, where=where, wait=True)
    if model.pad_count != entry["nodes"]:
        raise DermisError(
            "the skin has other nodes in this version",
            where=f"finger '{finger}'",
            value=entry["nodes"],
            limit=str(model.pad_count),
            remedy="Bake again",
        )
    with core.foreign.damage_told("the stored result cannot be read", str(path), remedy="Bake again"):
        with core.npz.opened_npz(path, kind="a stored result", trusted=True) as archive:
            prefix = f"{PREFIX}{i}_"
            file = archive.arrays([name for name in archive.names if name.startswith(prefix)])
        own = {name.removeprefix(prefix): array for name, array in file.items()}
        if _by_series(entry):  # amounts of the series' patterns; the law finds its own amounts from the forces
            own.pop("amounts", None)
        findings = tuple(Finding(**f) for f in entry["findings"])
        return core.contact.skin_arrays.touch_of(model, own, findings, entry["skipped"]).packed()


def _by_series(entry: Mapping[str, Any]) -> bool:
    """Return whether a skin's forces are from the series of earlier versions."""
    return entry.get("tissue", "linear") != "linear" and not entry.get("law", False)


def _as_it_was(finger: str) -> Finding:
    return Finding(
        "info",
        EARLIER,
        "its forces are of an earlier version of Dermis; only their displacement follows the neo-Hookean law",
        f"finger '{finger}'",
        remedy="Bake again, so that the forces follow the law, too",
    )


def export(bake: Any, folder: Path) -> list[Path]:
    """Write the resultants of a bake's skins as CSV files; return their paths.

    Raises:
        DermisError: the folder cannot be written.
    """
    names, written = core.track.file_names.FileNames(), []
    for finger, touch in bake.skins.items():
        path = Path(folder) / names.take(core.track.file_names.safe(finger) or "finger", ".skin.csv")
        meta = {"finger": finger, "content_hash": bake.content_hash}
        core.contact.resultants.write(touch, path, meta)
        written.append(path)
    return written
