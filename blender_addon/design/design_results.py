"""Answer 'How many motors?' from baked scenes and recordings.

An answer has a picture, and a new preset can be made of it.
"""

from __future__ import annotations

import re
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from .. import choices, identity
from .._core import DermisError, core
from ..devices import active_presets, platform_devices, skin_models
from ..preferences import library, presets_folder, user_folder
from ..results import store

IMAGE = "Dermis: How Many Motors?"


@dataclass(frozen=True)
class Answer:
    """An answer of the panel.

    Attributes:
        design: the engine's `Design`. preset: key of the preset made last, or ''. picture: path of the PNG.
    """

    design: Any
    preset: str
    picture: Path


_answers: dict[int, Answer] = {}


def current(scene: bpy.types.Scene) -> Answer | None:
    """Return the result of this scene's panel, in this session."""
    return _answers.get(scene.session_uid)


def checked_spec(scene: bpy.types.Scene) -> core.devices.spec.DeviceSpec:
    """Return the preset for which fewer motors are to be found.

    Raises:
        DermisError: it is not the preset of a platform, or its motors are coupled already.
    """
    device = scene.dermis_design.device
    spec = active_presets.spec_of(device, "platform")
    if spec is None:
        raise DermisError(
            "not a platform's preset",
            where="How Many Motors?",
            value=device,
            limit="a cable platform or a six-leg platform",
        )
    core.devices.coupling.refuse_coupled(spec)
    return spec


def find(scene: bpy.types.Scene) -> Generator[Any, None, Any]:
    """Find the fewest motors for the touches of a scene's panel.

    Yields progress, and returns the engine's `Design`.

    Raises:
        DermisError: nothing to render, a scene without a bake, a recording or table that cannot be used, skins of
            different fingers, or a touch that never touches.
    """
    settings, spec = scene.dermis_design, checked_spec(scene)
    task, progress = core.design.task, core.pipeline.bake.Progress
    yield progress("touches", 0, 1)
    sensed, skin = touches(scene)
    model = None
    if settings.table:
        table = task.load_table(spec, Path(bpy.path.abspath(settings.table)))
        if skin is not None:
            with skin_models.one_thread():
                model = skin_models.get(skin["skin"], skin["level"], skin["tissue"], wait=True)
    else:
        if skin is None:
            skin = {"skin": {}, "level": "draft", "tissue": "linear"}
        rows = settings.table_rows
        model, table = yield from platform_devices.swept(spec, skin["skin"], skin["level"], rows, skin["tissue"])
    return (yield from task.answer(spec, table, sensed, noise=settings.noise, skin=model, spread=not settings.table))


def asked(scene: bpy.types.Scene) -> list[tuple[bpy.types.Scene | None, Path]]:
    """Return the touches of a panel's list, each as a scene or, where that is None, as the path of a recording.

    If the list is empty, this scene is the only touch.
    """
    listed = [(item.scene, Path(bpy.path.abspath(item.filepath))) for item in scene.dermis_design.touches]
    return listed or [(scene, Path())]


def touches(scene: bpy.types.Scene) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Return the readings of each touch in a panel's list, and their skin.

    Readings are by the name of the touch. The skin is that of the baked touches; None without one.

    Raises:
        DermisError: an empty list, a scene without a bake of a skin, different skins, or an unusable recording.
    """
    task, settings = core.design.task, scene.dermis_design
    sensed: dict[str, Any] = {}
    skin: dict[str, Any] | None = None
    for number, (touched, path) in enumerate(asked(scene)):
        if touched is None:
            found = task.read_sensed([path])
        else:
            own, found = _baked(touched, settings, number)
            if skin is not None and own != skin:
                raise DermisError(
                    "its finger has a different skin than the scenes before",
                    where=f"scene '{touched.name}'",
                    remedy="Use one size and accuracy of skin",
                )
            skin = own
        for name, values in found.items():
            if name in sensed:
                raise DermisError("two touches have one name", where="How Many Motors?", value=name)
            sensed[name] = values
    if not sensed:
        raise DermisError("no touch is chosen", where="How Many Motors?", remedy="Add a baked scene or a recording")
    return sensed, skin


def make_preset(scene: bpy.types.Scene, found: Any) -> str:
    """Write the new preset into the user's presets; return its key.

    Raises:
        DermisError: more motors than the device has, or a folder that cannot be written.
    """
    coupled_preset, settings = core.design.coupled_preset, scene.dermis_design
    made = coupled_preset.preset(found, settings.rule, settings.motors or None)
    count = len(made["channels"])
    names = "_".join(re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") for name in found.names)[:40].strip("_")
    key = f"{found.spec.key}_{count}_motor{'s' if count > 1 else ''}_{names}"
    coupled_preset.write_preset(made, presets_folder() / "devices" / f"{key}.json")
    library().device(key)  # a preset that cannot be read again must be reported now
    active_presets.forget()
    choices.refresh()
    return key


def preset_findings(key: str) -> tuple[Any, ...]:
    """Return the reasons why a device preset cannot be streamed to."""
    return tuple(core.devices.safe_state.safe_findings(library().device(key)))


def keep(scene: bpy.types.Scene, found: Any, preset: str) -> Answer:
    """Draw the picture, load it as an image, and keep the result."""
    folder = user_folder("designs", create=True)
    picture = folder / f"{re.sub(r'[^A-Za-z0-9_-]+', '_', scene.name)}.png"
    core.design.picture.write_picture(found, picture, scene.dermis_design.rule)
    image = bpy.data.images.get(IMAGE)
    if image is None:
        image = bpy.data.images.load(str(picture))
        image.name = IMAGE
    image.filepath = str(picture)
    image.reload()
    _answers[scene.session_uid] = Answer(found, preset, picture)
    return _answers[scene.session_uid]


def save(scene: bpy.types.Scene, folder: Path) -> tuple[Path, ...]:
    """Write the reports and the preset into a folder; return their paths.

    The reports are report.txt, report.json and report.png.

    Raises:
        DermisError: nothing was found yet, or the folder cannot be written.
    """
    answer, settings = current(scene), scene.dermis_design
    if answer is None:
        raise DermisError("nothing was found yet", where="How Many Motors?", remedy="Press How Many Motors?")
    motors = settings.motors or None
    return core.design.task.write(answer.design, folder, rule=settings.rule, motors=motors)


def forget() -> None:
    """Drop results."""
    _answers.clear()


def _baked(scene: bpy.types.Scene, settings: Any, number: int) -> tuple[dict[str, Any], dict[str, Any]]:
    result = store.current(scene)
    where = f"scene '{scene.name}'"
    if result is None:
        raise DermisError("the scene is not baked", where=where, remedy="Bake it first")
    skins = result.bake.skins
    name = settings.finger or next(iter(skins), "")
    if name not in skins:
        raise DermisError(
            "the bake has no such skin",
            where=where,
            value=settings.finger or None,
            limit=", ".join(skins) or "show a finger's skin, or give it a platform, and bake",
        )
    kept = result.skins.get(name)
    if kept is None:
        obj = identity.named(scene, name)
        if obj is None:
            raise DermisError("the finger is gone", where=where, value=name, remedy="Bake again")
        kept = store.skin_of(obj)
    sensed = core.design.task.sense_touch(skins[name], noise=settings.noise, seed=number)
    title = scene.name.split(":")[-1].strip()
    own = {"skin": dict(kept["skin"]), "level": str(kept["level"]), "tissue": str(skins[name].model.tissue)}
    return own, {title: sensed}
