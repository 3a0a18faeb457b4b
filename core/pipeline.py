"""The whole way from a sampled scene to command tracks; it reads from top to bottom.

scene -> contact on the skin -> target stimulus -> device match -> command track -> file

`render` decides what a scene does not need: fingers without devices are not rendered, far objects are dropped
by the broad phase, and effects that nothing switches on are never computed. What was skipped is counted.
"""

from __future__ import annotations

import hashlib
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from .devices.spec import DeviceSpec
from .errors import DermisError, Finding
from .matching import SKIN_KINDS
from .presets import Library
from .scene import ContentHash, DeviceUse, TactileScene
from .track import Array, CommandTrack
from .version import version

if TYPE_CHECKING:
    from .cache import Cache
    from .contact.skin_touch import SkinTouch
    from .contact.touch import SampledTouch
    from .matching.rendered import Rendered
    from .skin.model import SkinModel

    Renderer = Callable[..., Rendered]


DEFAULT_SKIN = "index_medium"
# kind of device -> the file in matching/ that drives it
RENDERERS = {
    "shear_tactor": "projection",
    "friction_screen": "perceptual",
    "pin_array": "pins",
    "thimble": "thimble",
    "cable_platform": "lookup",
    "hexapod": "lookup",
}


@dataclass(frozen=True)
class Progress:
    """How far the work is: `done` of `total` steps of the named stage."""

    stage: str
    done: int
    total: int


@dataclass(frozen=True)
class Output:
    """The track of one device on one finger.

    Attributes:
        finger, device: the finger's name and the preset's key.
        track: what the device shall do, limited to what it can do.
        signals: diagnostic series at the track's times, such as 'contact'.
        findings: of the method and of the track's own check.
    """

    finger: str
    device: str
    track: CommandTrack
    signals: Mapping[str, Array]
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class Bake:
    """Everything that one rendering of a scene gave.

    Attributes:
        outputs: one per finger and device, in the scene's order.
        findings: of the scene as a whole; `all_findings` has those of the outputs too.
        skipped: what was not computed because the scene did not need it, by name.
        content_hash: hash of scene, device presets and version.
        stage_seconds: run time of each stage [s].
        skins: what the skin of each finger felt that shows it or wears a device that needs it, by finger's name.
    """

    outputs: tuple[Output, ...]
    findings: tuple[Finding, ...]
    skipped: Mapping[str, int]
    content_hash: str
    stage_seconds: Mapping[str, float] = field(default_factory=dict)
    skins: Mapping[str, SkinTouch] = field(default_factory=dict)

    @property
    def all_findings(self) -> tuple[Finding, ...]:
        """Findings of the scene and of every output."""
        return self.findings + tuple(f for output in self.outputs for f in output.findings)


def render(scene: TactileScene, library: Library, *, cache: Cache | None = None) -> Generator[Progress, None, Bake]:
    """Render every device of every finger; yield progress, return a `Bake`.

    Args:
        cache: where condensed skins are kept; without one they are made anew.

    Raises:
        DermisError: the scene cannot be rendered at all (see `TactileScene.validate`).
    """
    scene.validate()
    clock = _Stages()
    findings = [*scene.findings, *(f for screen in scene.screens for f in screen.findings)]
    wanted = list(_wanted(scene, library, findings))
    content = ContentHash(scene)

    skins = yield from _skins(scene, wanted, library, cache, clock, findings)
    touch, felt = yield from _sample(scene, skins, content, clock)
    findings += touch.findings
    skipped = Counter(touch.skipped)
    for skin in felt.values():
        findings += skin.findings
        skipped.update(skin.skipped)

    content_hash = _full_hash(content, [spec for _, _, spec in wanted])
    outputs = []
    for step, (finger, use, spec) in enumerate(wanted):
        yield Progress("devices", step, len(wanted))
        with clock.stage("devices"):
            try:
                more = (felt[finger],) if spec.kind in SKIN_KINDS else ()
                rendered = _renderer(spec)(touch, scene, finger, use, spec, *more)
                output = _finish(rendered, scene, finger, use, content_hash)
            except DermisError as error:  # one device that cannot be rendered does not take the others down
                findings.append(_unavailable(scene.fingers[finger].name, error))
                continue
        skipped.update(rendered.skipped)
        outputs.append(output)
    yield Progress("devices", len(wanted), len(wanted))
    by_name = {scene.fingers[finger].name: skin for finger, skin in felt.items()}
    return Bake(tuple(outputs), tuple(findings), skipped, content_hash, clock.seconds, by_name)


def run(scene: TactileScene, library: Library | None = None) -> Bake:
    """Render a scene straight through, without progress."""
    steps = render(scene, library or Library())
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            bake: Bake = stop.value
            return bake


def export(bake: Bake, folder: Path, *, plots: bool = False) -> tuple[Path, ...]:
    """Write one CSV per finger and device into a folder, and on request a PNG plot beside each.

    Raises:
        DermisError: nothing to export, or the folder cannot be written.
    """
    from .formats import csv

    if not bake.outputs:
        raise DermisError("no tracks to export", where=str(folder), remedy="Give a finger a device and bake again")
    written = []
    for name, output in zip(file_names(bake), bake.outputs, strict=True):
        path = Path(folder) / f"{name}.csv"
        csv.write(output.track, path)
        written.append(path)
        if plots:
            from .plot import write_png

            picture = path.with_suffix(".png")
            write_png(output.track, picture, contact=output.signals.get("contact"))
            written.append(picture)
    return tuple(written)


def export_screen_maps(scene: TactileScene, library: Library, folder: Path) -> tuple[Path, ...]:
    """Write the map and the law of every screen device, for screens that answer to a real finger.

    Only the scene's first chunk is read: where the screens stand then gives the scale.

    Raises:
        DermisError: no finger has a screen device, a map cannot be used, or the folder cannot be written.
    """
    from .matching.perceptual import screen_maps

    wanted = [
        (finger, use, spec)
        for finger, use, spec in _wanted(scene, library, [])
        if spec.kind == "friction_screen" and use.parameters.get("relief", "map") != "mesh"  # a mesh needs no map
    ]
    if not wanted:
        raise DermisError(
            "no finger has a screen device",
            where=f"scene '{scene.name}'",
            remedy="Add a touch screen, and an electrovibration device to the finger that touches it",
        )
    chunk = next(iter(scene.chunks))
    written: dict[Path, None] = {}
    for finger, use, spec in wanted:
        for index, screen_map in screen_maps(scene, chunk.screens, use, spec).items():
            stem = f"{_safe(scene.fingers[finger].name)}.{_safe(scene.screens[index].name)}.{use.preset}"
            path = Path(folder) / f"{stem}.map.npz"
            screen_map.save(path)
            written[path] = None
    return tuple(written)


def _safe(name: str) -> str:
    """Return a name that every file system takes."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in name)


def file_names(bake: Bake) -> tuple[str, ...]:
    """Return a file stem per output: finger and device, safe on every file system, never the same twice."""
    names: list[str] = []
    for output in bake.outputs:
        stem = name = f"{_safe(output.finger) or 'finger'}.{output.device}"
        number = 2
        while name.lower() in {n.lower() for n in names}:
            name = f"{stem}-{number}"
            number += 1
        names.append(name)
    return tuple(names)


def _wanted(
    scene: TactileScene, library: Library, findings: list[Finding]
) -> Iterator[tuple[int, DeviceUse, DeviceSpec]]:
    """Pair every finger with the devices that can be driven; say which cannot, and go on."""
    for i, finger in enumerate(scene.fingers):
        if not finger.devices and not finger.parameters.get("skin_shown", False):
            findings.append(
                Finding(
                    "warning",
                    "no-device",
                    "the finger has no device, so it gives no track",
                    where=f"finger '{finger.name}'",
                    remedy="Add one in the Dermis tab under Devices",
                )
            )
        for use in finger.devices:
            try:
                spec = library.device(use.preset)
                _renderer(spec)
            except DermisError as error:
                findings.append(_unavailable(finger.name, error))
                continue
            yield i, use, spec


def _unavailable(finger: str, error: DermisError) -> Finding:
    return Finding("error", "device-unavailable", str(error).rstrip("."), where=f"finger '{finger}'")


def _skins(
    scene: TactileScene,
    wanted: list[tuple[int, DeviceUse, DeviceSpec]],
    library: Library,
    cache: Cache | None,
    clock: _Stages,
    findings: list[Finding],
) -> Generator[Progress, None, dict[int, SkinModel]]:
    """Make the skins of the fingers that show theirs or wear a device that needs it; nobody else's.

    A finger whose skin cannot be made loses the devices that need it; the others are rendered.
    """
    needed = {f for f, _, spec in wanted if spec.kind in SKIN_KINDS}
    needed |= {f for f, finger in enumerate(scene.fingers) if finger.parameters.get("skin_shown", False)}
    skins: dict[int, SkinModel] = {}
    for done, f in enumerate(sorted(needed)):
        yield Progress("skin", done, len(needed))
        from .skin.model import skin_from_parameters

        finger = scene.fingers[f]
        place = f"finger '{finger.name}'"
        try:
            with clock.stage("skin"):
                parameters = finger.parameters.get("skin") or library.skin(DEFAULT_SKIN)
                level = str(finger.parameters.get("skin_level", "standard"))
                skins[f] = skin_from_parameters(parameters, level=level, cache=cache, where=f"{place}, skin")
        except DermisError as error:
            findings.append(_unavailable(finger.name, error))
            wanted[:] = [w for w in wanted if w[0] != f or w[2].kind not in SKIN_KINDS]
    return skins


def _sample(
    scene: TactileScene, skins: Mapping[int, SkinModel], content: ContentHash, clock: _Stages
) -> Generator[Progress, None, tuple[SampledTouch, dict[int, SkinTouch]]]:
    """Draw the chunks through the contact of the pads' centres and, where somebody needs it, of the whole skin."""
    from .contact.touch import TouchSampler

    pads, skin = TouchSampler(scene), None
    if skins:
        from .contact.skin_touch import SkinSampler

        skin = SkinSampler(scene, skins)
    done = 0
    chunks = content.through(scene.chunks)
    while True:
        with clock.stage("sampling"):
            chunk = next(chunks, None)
        if chunk is None:
            break
        with clock.stage("contact"):
            pads.add(chunk)
        if skin is not None:
            with clock.stage("skin contact"):
                skin.add(chunk)
        done += len(chunk.times)
        yield Progress("sampling", done, scene.sample_count)
    with clock.stage("contact"):
        touch = pads.finish()
    if skin is None:
        return touch, {}
    held = skin.solve_held(touch)
    while True:
        with clock.stage("skin contact"):
            solved = next(held, None)
        if solved is None:
            break
        yield Progress("skin contact", solved, scene.sample_count)
    return touch, skin.finish()


def _renderer(spec: DeviceSpec) -> Renderer:
    """Return the method that drives this kind of device; its module loads only now."""
    if spec.kind not in RENDERERS:
        raise DermisError(
            "unknown kind of device",
            where=f"device preset '{spec.key}'",
            value=spec.kind,
            limit=", ".join(RENDERERS),
        )
    render: Renderer = import_module(f".matching.{RENDERERS[spec.kind]}", __package__).render
    return render


def _finish(rendered: Rendered, scene: TactileScene, finger: int, use: DeviceUse, content_hash: str) -> Output:
    """Limit the track to what the device can do, check it, and write down where it comes from."""
    name = scene.fingers[finger].name
    limited = rendered.track.within_limits()
    meta = {
        "finger": name,
        "scene": scene.name,
        "frame_range": f"{scene.frame_range[0]} {scene.frame_range[1]}",
        "fps": f"{scene.fps.numerator}/{scene.fps.denominator}",
        "generator": f"dermis {version()}",
        "content_hash": content_hash,
        **limited.meta,
    }
    track = replace(limited, meta=meta)
    findings = tuple(rendered.findings) + tuple(track.check())
    return Output(name, use.preset, track, rendered.signals, findings)


def _full_hash(content: ContentHash, specs: list[DeviceSpec]) -> str:
    """Hash of the scene's content, the presets it uses and the version that rendered it."""
    parts = [content.hexdigest(), version(), *(spec.hash for spec in specs)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


class _Stages:
    """Adds up run time by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time of a block towards a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
