"""Find the owners of a bake: its fingers and devices, by their identities.

A bake names fingers as they were called when it was made. All readers of a result get it with the present names. A
track whose finger has left the scene is left out. No other object gets it, whatever the name of that object is.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import bpy

from .. import changes, identity
from .._core import core
from ..identity import Device, Place
from . import stored_skins

NOBODY = Device("", "")


class Owner(NamedTuple):
    """A finger of a bake.

    `devices` has the preset and the identity of each enabled device, in their order.
    """

    identity: str
    devices: tuple[tuple[str, str], ...]


Owners = Mapping[str, Owner]
"""The owners of a bake, by the names of the fingers when it was made."""


def of(scene: bpy.types.Scene, names: Sequence[str] | None = None) -> dict[str, Owner]:
    """Return the fingers of a scene as owners of a bake.

    Each finger is given an identity if it has none.

    Args:
        names: names of the fingers to return; None for all.
    """
    found = {}
    for obj in identity.fingers(scene):
        if names is None or obj.name_full in names:
            own = identity.give(obj)
            found[obj.name_full] = Owner(own, tuple((item.preset, d.device) for d, item in identity.worn(obj)))
    return found


def dumps(owners: Owners) -> str:
    """Return owners as a text that is kept in the .blend."""
    return json.dumps({name: [owner.identity, [list(d) for d in owner.devices]] for name, owner in owners.items()})


def loads(text: str) -> dict[str, Owner]:
    """Return the owners that a text of `dumps` names; none if it is empty.

    Raises:
        DermisError: the text is not one of `dumps`.
    """
    if not text:
        return {}
    where = "the stored bake's owners"
    with core.foreign.damage_told("the file does not name the fingers of its stored bake", where, remedy="Bake again"):
        plain = core.foreign.json_of(text.encode(), where, core.foreign.MAX_TEXT)
        read = {
            name: Owner(str(own), tuple((str(p), str(d)) for p, d in devices)) for name, (own, devices) in plain.items()
        }
        if not all(identity.is_identity(owner.identity) for owner in read.values()):
            raise ValueError("an identity has 32 hexadecimal digits")
    return read


def whose(owners: Owners, outputs: Sequence[Any]) -> tuple[Device, ...]:
    """Return the device that each output of a bake belongs to.

    Several devices of one preset on a finger are distinguished by their order.
    """
    found: list[Device] = []
    taken: dict[tuple[str, str], int] = {}
    count = Counter((output.finger, output.device) for output in outputs)
    for output in outputs:
        owner, key = owners.get(output.finger), (output.finger, output.device)
        if owner is None:
            found.append(NOBODY)
            continue
        same = [device for preset, device in owner.devices if preset == output.device]
        nth = taken[key] = taken.get(key, -1) + 1
        # If one of several such devices was not rendered, the outputs cannot be assigned: they get no device identity.
        found.append(Device(owner.identity, same[nth] if len(same) == count[key] else ""))
    return tuple(found)


class RenamedSkins(Mapping[str, Any]):
    """The skins of a bake by other names, read when they are first needed.

    Args:
        skins: the skins of the bake. names: the name of each skin in the bake, by its present name.
    """

    def __init__(self, skins: Mapping[str, Any], names: Mapping[str, str]) -> None:
        self.skins, self.names = skins, names

    def __getitem__(self, finger: str) -> Any:
        return self.skins[self.names[finger]]

    def __iter__(self) -> Iterator[str]:
        return (now for now, then in self.names.items() if then in self.skins)

    def __len__(self) -> int:
        return min(len(self.names), len(self.skins))

    @property
    def forces(self) -> dict[str, tuple[Any, Any]]:
        """Times [s] and normal forces [N] of every skin, without reading a skin."""
        found = stored_skins.forces_of(self.skins)
        return {now: found[then] for now, then in self.names.items() if then in found}


@dataclass
class _View:
    """A result with present names, and the state that these depend on."""

    result: Any
    seen: Any
    places: list[Place]
    missing: bool
    looked: tuple[int, int, int]

    def holds(self, result: Any, scene: bpy.types.Scene) -> bool:
        """Return whether the result and the names of its fingers are the same."""
        if self.result is not result or (self.missing and self.looked != _looked()):
            return False
        objects = ((place, place.finger(scene)) for place in self.places)
        return all(obj is not None and obj.name_full == place.name for place, obj in objects)


_views: dict[int, _View] = {}  # by the scene's session uid


def as_now(scene: bpy.types.Scene, result: Any) -> Any:
    """Return a `Result` with present names.

    It is the same object while these names are the same.
    """
    view = _views.get(scene.session_uid)
    if view is None or not view.holds(result, scene):
        view = _views[scene.session_uid] = _seen(scene, result)
    return view.seen


def forget() -> None:
    """Forget earlier look-ups."""
    _views.clear()


def _looked() -> tuple[int, int, int]:
    return changes.ticks(), identity.revision(), len(bpy.data.objects)


def _seen(scene: bpy.types.Scene, result: Any) -> _View:
    by_identity = {own: obj for obj in identity.fingers(scene) if (own := identity.identity(obj))}
    found = {name: by_identity.get(owner.identity) for name, owner in result.owners.items()}
    objects = {name: obj for name, obj in found.items() if obj is not None}
    now = {name: obj.name_full for name, obj in objects.items()}
    bake, skins = result.bake, list(stored_skins.forces_of(result.bake.skins))  # the names; no skin is read
    seen = result
    if any(now.get(name) != name for name in (*skins, *(output.finger for output in bake.outputs))):
        there = [i for i, output in enumerate(bake.outputs) if output.finger in now]
        seen = replace(
            result,
            bake=replace(
                bake,
                outputs=tuple(_output(bake.outputs[i], now) for i in there),
                findings=tuple(_finding(f, now) for f in bake.findings),
                skins=RenamedSkins(bake.skins, {now[name]: name for name in skins if name in now}),
            ),
            whose=tuple(result.whose[i] for i in there),
            skins={now[name]: made for name, made in result.skins.items() if name in now},
            names=now,
        )
    places = [Place.of(obj) for obj in objects.values()]
    return _View(result, seen, places, len(now) < len(found), _looked())


def inputs_now(result: Any) -> dict[str, dict[str, str]]:
    """Return the hashes of a result's inputs, with present names."""
    now = {}
    for then in result.owners if result.names else ():
        gone = f"finger '{then}', as it was called then,"  # another finger may have this name now
        now[f"finger '{then}'"] = f"finger '{result.names[then]}'" if then in result.names else gone
    return {now.get(name, name): dict(aspects) for name, aspects in result.bake.inputs.items()}


def _output(output: Any, now: Mapping[str, str]) -> Any:
    name = now[output.finger]
    if name == output.finger:
        return output
    return replace(output, finger=name, findings=tuple(_finding(f, now) for f in output.findings))


def _finding(finding: Any, now: Mapping[str, str]) -> Any:
    where = re.sub(r"finger '([^']+)'", lambda m: f"finger '{now.get(m[1], m[1])}'", finding.where)
    return finding if where == finding.where else replace(finding, where=where)
