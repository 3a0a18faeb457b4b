"""The whole way from a sampled scene to command tracks; it reads from top to bottom.

scene -> contact of the pads' centres and of the skins -> each device's commands -> command tracks within limits

`outputs` writes them to files.

`render` decides what a scene does not need: fingers without devices are not rendered, far objects are dropped
by the broad phase, and effects that nothing switches on are never computed. What was skipped is counted.
"""

from __future__ import annotations

import hashlib
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING

from ..contact.chunk_checks import check_device
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..parameters.skin import DEFAULT_SKIN, SKIN_CONTACT
from ..presets import Library
from ..scene.content_hash import ContentHash
from ..scene.tactile_scene import DeviceUse, TactileScene
from ..steps import drain
from ..version import version
from .bake import Bake, Progress
from .device_tracks import finished, renderer, unavailable, usable

if TYPE_CHECKING:
    from ..cache import Cache
    from ..contact.pad_contact import PadContact
    from ..contact.skin_contact import SkinContact
    from ..matching.rendered import Rendered
    from ..skin.model import SkinModel

    Renderer = Callable[..., Rendered]


def render(scene: TactileScene, library: Library, *, cache: Cache | None = None) -> Generator[Progress, None, Bake]:
    """Render every device of every finger; yield progress, return a `Bake`.

    Args:
        library: the presets.
        cache: where condensed skins are kept; without one they are made anew.

    Raises:
        DermisError: the scene cannot be rendered at all (see `TactileScene.validate`).
    """
    scene.validate()
    clock = _Stages()
    findings = [*scene.findings, *(f for screen in scene.screens for f in screen.findings)]
    uses = list(usable(scene, library, findings))
    content = ContentHash(scene)

    skin_models = yield from _skin_models(scene, uses, library, cache, clock, findings)
    if skin_models:
        from ..skin.blas import one_thread

        clock.hold = one_thread
    pad_contact, skin_contacts = yield from _contact(scene, skin_models, content, clock)
    findings += pad_contact.findings
    skipped = Counter(pad_contact.skipped)
    for contact in skin_contacts.values():
        findings += contact.findings
        skipped.update(contact.skipped)

    tables = [mark for f, contact in skin_contacts.items() for mark in _tables_of(scene.fingers[f].name, contact)]
    content_hash = _full_hash(content, [spec for _, _, spec in uses], tables)
    outputs = []
    for step, (finger, use, spec) in enumerate(uses):
        yield Progress("devices", step, len(uses))
        with clock.stage("devices"):
            try:
                check_device(pad_contact, scene.fingers[finger], finger, use)
                more = (skin_contacts[finger],) if spec.follows_skin else ()
                rendered = renderer(spec)(pad_contact, scene, finger, use, spec, *more)
                output = finished(rendered, scene, finger, use, content_hash)
            except DermisError as error:  # one device that cannot be rendered does not take the others down
                findings.append(unavailable(scene.fingers[finger].name, error))
                continue
        skipped.update(rendered.skipped)
        outputs.append(output)
    yield Progress("devices", len(uses), len(uses))
    by_name = {scene.fingers[finger].name: contact for finger, contact in skin_contacts.items()}
    return Bake(tuple(outputs), tuple(findings), skipped, content_hash, clock.seconds, by_name)


def run(scene: TactileScene, library: Library | None = None) -> Bake:
    """Render a scene straight through, without progress.

    Args:
        library: the presets; the built-in ones where None.

    >>> import dermis
    >>> finger = dermis.Finger("Index", (dermis.DeviceUse("haptip"),))
    >>> table = dermis.Body("Table", dermis.Surface.block().mesh, dermis.Library().material("wood"))
    >>> way = [(0.0, 0.0, 10e-3 - 0.2 * i / 240) for i in range(25)]  # down at 0.2 m/s
    >>> bake = dermis.run(dermis.scene_from_poses(240.0, [(finger, way)], [(table, (0.0, 0.0, 0.0))]))
    >>> bake
    Bake(Index: haptip; 0 skins, 0 findings)
    >>> bake.outputs[0].track
    CommandTrack(haptip, 4 channels, 101 samples, 0.1 s at 1000 Hz)

    Raises:
        DermisError: the scene cannot be rendered at all (see `TactileScene.validate`).
    """
    return drain(render(scene, library or Library()))


def _skin_models(
    scene: TactileScene,
    uses: list[tuple[int, DeviceUse, DeviceSpec]],
    library: Library,
    cache: Cache | None,
    clock: _Stages,
    findings: list[Finding],
) -> Generator[Progress, None, dict[int, SkinModel]]:
    """Make the skins of the fingers that show theirs or wear a device that needs it; nobody else's.

    A finger whose skin cannot be made loses the devices that need it; the others are rendered.
    """
    needed = {f for f, _, spec in uses if spec.follows_skin}
    needed |= {f for f, finger in enumerate(scene.fingers) if SKIN_CONTACT["skin_shown"].of(finger.parameters)}
    skin_models: dict[int, SkinModel] = {}
    for done, f in enumerate(sorted(needed)):
        yield Progress("skin", done, len(needed))
        from ..tissue.finger_skin import finger_skin

        finger = scene.fingers[f]
        place = f"finger '{finger.name}'"
        try:
            with clock.stage("skin"):
                preset = library.skin(DEFAULT_SKIN)
                skin_models[f] = finger_skin(finger.parameters, preset, cache=cache, where=place)
        except DermisError as error:
            findings.append(unavailable(finger.name, error))
            uses[:] = [w for w in uses if w[0] != f or not w[2].follows_skin]
    return skin_models


def _contact(
    scene: TactileScene, skin_models: Mapping[int, SkinModel], content: ContentHash, clock: _Stages
) -> Generator[Progress, None, tuple[PadContact, dict[int, SkinContact]]]:
    """Draw the chunks through the contact of the pads' centres and, where somebody needs it, of the whole skin.

    The pads come first: surfaces that are not finite are mended there, and the skins get the mended chunk.
    """
    from ..contact.pad_sampler import PadSampler

    pads, skin = PadSampler(scene), None
    if skin_models:
        from ..contact.skin_sampler import SkinSampler

        skin = SkinSampler(scene, skin_models)
    done = 0
    chunks = content.through(scene.chunks)
    while True:
        with clock.stage("sampling"):
            chunk = next(chunks, None)
        if chunk is None:
            break
        with clock.stage("contact"):
            chunk = pads.add(chunk)
        if skin is not None:
            with clock.stage("skin contact"):
                skin.add(chunk)
        done += len(chunk.times)
        yield Progress("sampling", done, scene.sample_count)
    with clock.stage("contact"):
        pad_contact = pads.finish()
    if skin is None:
        return pad_contact, {}
    held = skin.solve_held(pad_contact)
    while True:
        with clock.stage("skin contact"):
            solved = next(held, None)
        if solved is None:
            break
        yield Progress("skin contact", solved, scene.sample_count)
    return pad_contact, skin.finish()


def _tables_of(finger: str, contact: SkinContact) -> list[str]:
    """Return what of a finger's skin depends on tables that may be there or not: it is otherwise as the scene says."""
    stiffening = contact.model.stiffening
    on_points = [] if contact.points is None else [finger]
    return on_points if stiffening is None else [*on_points, f"{finger} {stiffening.key}"]


def _full_hash(content: ContentHash, specs: list[DeviceSpec], tables: list[str]) -> str:
    """Hash of the scene's content, the presets it uses, the version that rendered it and the skins' tables.

    The last since the table of a smooth pad, or of how tissue stiffens, may be there or not: whoever asked for points
    or for such tissue then gets something else.
    """
    parts = [content.hexdigest(), version(), *(spec.hash for spec in specs), *tables]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


class _Stages:
    """Adds up run time by stage.

    Attributes:
        hold: what holds while a stage runs, and nobody else does.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.hold: Callable[[], AbstractContextManager[object]] = nullcontext

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time of a block towards a stage."""
        start = time.perf_counter()
        try:
            with self.hold():
                yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
