"""render: from a sampled scene to command tracks.

The steps, in the order of the code:

scene -> contact of the pads' centres and of the skins -> each device's commands -> command tracks within limits

`outputs` writes the tracks to files.

`render` also decides which work a scene does not need. A skin is simulated only if it is shown or if a device follows
it, the broad phase drops far objects, and effects that are switched off are not computed. `skipping` has the table of
skipped work, with conditions and counters.

Fingers that hold no object together are independent of each other. With an executor, `shares` lets other processes
render them, to the same bytes.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Generator, Iterator
from typing import TYPE_CHECKING

from ..devices.kinds import KINDS
from ..devices.mechanism import kind_of
from ..devices.spec import DeviceSpec
from ..parameters.finger import FINGER
from ..parameters.skin import SKIN_CONTACT
from ..presets import Library
from ..scene.content_hash import ContentHash
from ..scene.tactile_scene import DeviceUse, TactileScene, unknown_settings
from ..steps import drain
from ..version import made_by
from .bake import Bake, Progress
from .device_tracks import Driven, driven, usable
from .felt import skin_models, touched
from .inputs import inputs_of
from .stages import Stages

RENDERERS = {kind.renderer for kind in KINDS.values()}

if TYPE_CHECKING:
    from ..cache import Cache
    from ..work.executor import JobExecutor
    from .kept_shares import KeptShares


def render(
    scene: TactileScene,
    library: Library,
    *,
    cache: Cache | None = None,
    executor: JobExecutor | None = None,
    before: KeptShares | None = None,
) -> Generator[Progress, None, Bake]:
    """Render every device of every finger; yield progress, return a `Bake`.

    Args:
        scene: the scene.
        library: the presets.
        cache: cache of condensed skins; None to condense them anew.
        executor: executor with child processes, which render fingers in parallel if that saves time. The results are
            the same to the byte.
        before: results of earlier bakes, or None. Fingers with unchanged inputs are taken from there, and newly
            rendered fingers are added. The results are the same to the byte.

    Raises:
        DermisError: the scene cannot be rendered at all (see `TactileScene.validate`).
    """
    scene.validate()
    clock = Stages()
    findings = [*scene.findings, *unknown_settings(scene), *(f for screen in scene.screens for f in screen.findings)]
    uses = list(usable(scene, library, findings))
    content = ContentHash(scene)

    needed = {f for f, _, spec in uses if spec.follows_skin}
    needed |= {f for f, finger in enumerate(scene.fingers) if SKIN_CONTACT["skin_shown"].of(finger.parameters)}
    models = yield from skin_models(scene, needed, library, cache, clock, findings)
    uses = [(f, use, spec) for f, use, spec in uses if f in models or not spec.follows_skin]
    chunks = content.through(scene.chunks)
    ready: dict[int, Iterator[Driven]] = {}
    rigid = all(body.mesh is not None for body in scene.bodies)  # surfaces of deforming bodies are too large for shares
    unchanged = 0
    # The other processes read the scene from a file.
    several = executor is not None and executor.shares_files and executor.workers > 1 and len(models) > 1
    if rigid and models and (several or before is not None):
        from .shares import touched_in_shares

        near = executor if several else None
        touch = touched_in_shares(scene, chunks, models, library, cache, clock, near, before)
        pad_contact, skin_contacts, ready, unchanged = yield from touch
    else:
        pad_contact, skin_contacts = yield from touched(scene, chunks, models, clock)
    findings += pad_contact.findings
    if models or uses:
        from ..contact.closest_approach import nothing_touched

        findings += nothing_touched(scene, pad_contact, skin_contacts, _by_pad(scene, uses))
    skipped = Counter(pad_contact.skipped)
    skipped["fingers_unchanged"] = unchanged
    skipped["fingers_without_skin"] = len(scene.fingers) - len(needed)
    skipped["renderers_not_loaded"] = len(RENDERERS - {kind_of(spec).renderer for _, _, spec in uses})
    for contact in skin_contacts.values():
        findings += contact.findings
        skipped.update(contact.skipped)

    tables = [scene.fingers[f].name for f, contact in skin_contacts.items() if contact.points is not None]
    content_hash = _full_hash(content, [spec for _, _, spec in uses], tables)
    outputs = []
    for step, (finger, use, spec) in enumerate(uses):
        yield Progress("devices", step, len(uses))
        with clock.stage("devices"):
            if spec.follows_skin and finger in ready:
                made = next(ready[finger]).stamped(content_hash)
            else:
                felt = skin_contacts[finger] if spec.follows_skin else None
                made = driven(pad_contact, scene, finger, use, spec, felt, content_hash)
        findings += made.findings
        skipped.update(made.skipped)
        if made.output is not None:
            outputs.append(made.output)
    yield Progress("devices", len(uses), len(uses))
    by_name = {scene.fingers[finger].name: contact.packed() for finger, contact in skin_contacts.items()}
    skipped = Counter({name: count for name, count in skipped.items() if count})
    inputs = inputs_of(scene, content, library)
    return Bake(tuple(outputs), tuple(findings), skipped, content_hash, clock.seconds, by_name, inputs)


def run(scene: TactileScene, library: Library | None = None) -> Bake:
    """Render a scene and return its `Bake`; like `render`, without progress.

    Args:
        scene: the scene.
        library: the presets; None for the built-in ones.

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


def _by_pad(scene: TactileScene, uses: list[tuple[int, DeviceUse, DeviceSpec]]) -> set[int]:
    """Return the fingers with a device that follows the touch of the pad's centre, and no pattern or screen."""
    by_pad = {f for f, _, spec in uses if not spec.follows_skin and kind_of(spec).drawn != "screen"}
    return {f for f in by_pad if FINGER["pattern"].of(scene.fingers[f].parameters) == "none"}


def _full_hash(content: ContentHash, specs: list[DeviceSpec], tables: list[str]) -> str:
    """Return the hash of a bake's inputs, the version included.

    Args:
        content: hash of the scene's content.
        specs: presets of the devices.
        tables: names of the fingers whose contact was solved at points. Points need the table of a smooth pad. If the
            table is missing, contact is solved at nodes, and the results differ.
    """
    parts = [content.hexdigest(), made_by(), *(spec.hash for spec in specs), *tables]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
