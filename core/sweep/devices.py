"""The study 'devices': scenes rendered by a device.

Dimensions and settings of the device, skin and materials can vary.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..comparison.device_comparison import row_of
from ..comparison.measures import judge, rms
from ..comparison.wearing import alone, finger_index
from ..errors import DermisError, worst
from ..files import read_bytes
from ..parameters.device import DEVICE
from ..parameters.finger import FINGER
from ..parameters.material import BODY
from ..parameters.parameter import Table
from ..parameters.skin import SKIN_CONTACT
from ..pipeline.bake import Progress
from ..pipeline.render import render
from ..pipeline.shot import opened_shot, presets_of
from ..pipeline.shots import Skins, skins_of
from ..presets import Library
from ..scene import scene_file
from ..scene.tactile_scene import DeviceUse, TactileScene
from ..steps import drain
from ..work.executor import JobExecutor
from ..work.jobs import Report
from ..work.spread import Asked
from .row import Row, row_key
from .spec import Spec, Value
from .variant import check_keys, dimensions

SETTINGS: Mapping[str, Table] = {"use": DEVICE, "finger": {**FINGER, **SKIN_CONTACT}, "body": BODY}
COLUMNS = ("method", "content_hash", "samples", "clipped", "out_of_reach", "worst", "findings")


def rows(spec: Spec, library: Library) -> list[Row]:
    """Return the rows of a sweep, scene by scene.

    Raises:
        DermisError: a parameter cannot vary, a preset is unknown, or a scene cannot be read.
    """
    check_keys(spec, ("device", "skin"), ("device", *SETTINGS))
    own = presets_of(library)
    short = len({path.name for path in spec.scenes}) == len(spec.scenes)
    made = []
    for path in spec.scenes:
        content = sha256(read_bytes(path)).hexdigest()
        for values in spec.variants():
            preset = dimensions(values, library, spec.where)
            texts = own if preset is None else {**own, f"devices/{values['device']}.json": json.dumps(preset)}
            given = {"values": values, "finger": spec.finger, "presets": texts}
            name = path.name if short else path.as_posix()
            made.append(Row(row_key("devices", content, given), {"scene": name, **values}, given, path))
    return made


def prepare(
    wanted: Sequence[Row], _spec: Spec, library: Library, executor: JobExecutor, stack: ExitStack, _folder: Path
) -> Generator[Progress, None, Callable[[Row], Asked]]:
    """Compute the skins that rows need; yields progress.

    Returns:
        Function that returns the job of a row.
    """
    skins = Skins(executor, stack)
    needed = {row.key: _skins(row, library) for row in wanted}
    yield from skins.make(skin for own in needed.values() for skin in own)

    def asked(row: Row) -> Asked:
        assert row.scene is not None
        arrays, place = skins.given(row.scene, needed[row.key])
        return Asked("sweep-row", arrays, {"study": "devices", "name": str(row.scene), **row.given, **place})

    return asked


def _skins(row: Row, library: Library) -> list[str]:
    """Return the skins that a row needs.

    The list is empty for a row that will be refused.
    """
    assert row.scene is not None
    try:
        scene, _, _ = varied(scene_file.load(row.scene), row.given["values"], row.given["finger"], library)
        return list(dict.fromkeys(skins_of(scene, library)))
    except DermisError:
        return []


def varied(
    scene: TactileScene, values: Mapping[str, Value], finger: str | int, library: Library
) -> tuple[TactileScene, str, DeviceUse]:
    """Return a variant of a scene, in which one finger wears one device.

    Args:
        scene: the scene.
        values: values of the variant. 'device' and 'skin' are keys of presets; without them the finger keeps its first
            device and its own skin. 'use.NAME', 'finger.NAME' and 'body.NAME' are settings in SI units.
        finger: name or index of the finger.
        library: library of the presets.

    Returns:
        The scene, the finger's name, and the device that the finger wears.

    Raises:
        DermisError: a finger, device, skin or setting does not exist, or a value is out of range.
    """
    where = "sweep"
    number = finger_index(scene, finger)
    worn = scene.fingers[number]
    if "device" not in values and not worn.devices:
        raise DermisError("the finger wears no device", where=f"finger '{worn.name}'", remedy='Give "device" a value')
    key = str(values.get("device", worn.devices[0].preset if worn.devices else ""))
    own = next((use for use in worn.devices if use.preset == key), DeviceUse(key))
    use = replace(own, parameters={**own.parameters, **_settings("use", values, where)})
    parameters = {**worn.parameters, **_settings("finger", values, where)}
    if "skin" in values:
        parameters["skin"] = library.skin(str(values["skin"]))
    fingers = list(alone(scene, library))
    fingers[number] = replace(worn, devices=(use,), parameters=parameters)
    given = _settings("body", values, where)
    bodies = tuple(replace(body, parameters={**body.parameters, **given}) for body in scene.bodies)
    return replace(scene, fingers=tuple(fingers), bodies=bodies), worn.name, use


def _settings(kind: str, values: Mapping[str, Value], where: str) -> dict[str, Any]:
    """Return the settings of one kind, checked by their parameters."""
    found = {}
    for key, value in values.items():
        first, _, name = key.partition(".")
        if first == kind:
            if name not in SETTINGS[kind]:
                raise DermisError("no such setting", where=f"{where}, {key}", limit=", ".join(sorted(SETTINGS[kind])))
            SETTINGS[kind][name].check(value, f"{where}, {key}")
            found[name] = value
    return found


def work(arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Report) -> dict[str, Value]:
    """Render one row and return its measures.

    Args:
        arrays, parameters: those of the job 'shot', and the row's own parameters.
        report: called with the progress.

    Raises:
        DermisError: the scene or the device cannot be rendered or judged.
    """
    with opened_shot(arrays, parameters) as given:
        scene = scene_file.load(given.scene)
        worn, name, use = varied(scene, parameters["values"], parameters["finger"], given.library)
        steps = render(worn, given.library, cache=given.cache)
        bake = drain(steps, lambda step: report(step.done, step.total))
    output = next((o for o in bake.outputs if o.finger == name and o.device == use.preset), None)
    where = f"finger '{name}', {use.preset}"
    if output is None:
        said = "; ".join(str(finding) for finding in bake.findings)
        raise DermisError("nothing was rendered", where=where, value=said or None)
    judged = judge(output, bake.skins.get(name), use.parameters)
    if judged is None:
        raise DermisError(
            "this touch gives the device nothing to render", where=where, remedy="Let the finger touch an object"
        )
    row, found = row_of(output, judged), bake.all_findings
    told: tuple[Value, ...] = (row.method, bake.content_hash, len(output.track.times), row.clipped, judged.out_of_reach)
    made = dict(zip(COLUMNS, (*told, worst(found) or "", " ".join(sorted({f.code for f in found}))), strict=True))
    for measure in judged.measures:
        stem = measure.name.replace(" ", "_")
        made |= {f"{stem}_target": rms(measure.target), f"{stem}_rendered": rms(measure.rendered)}
        made[f"{stem}_off"] = measure.off
    return made
