"""Contact of the pads' centres and, if needed, of whole skins in a scene."""

from __future__ import annotations

import json
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from ..errors import DermisError, Finding
from ..parameters.skin import DEFAULT_SKIN
from ..presets import Library
from ..scene.tactile_scene import Chunk, TactileScene
from .bake import Progress
from .device_tracks import unavailable
from .stages import Stages

if TYPE_CHECKING:
    from ..cache import Cache
    from ..contact.pad_contact import PadContact
    from ..contact.skin_contact import SkinContact
    from ..contact.skin_sampler import SkinSampler
    from ..skin.model import SkinModel


def skin_models(
    scene: TactileScene,
    fingers: Collection[int],
    library: Library,
    cache: Cache | None,
    clock: Stages,
    findings: list[Finding],
    alike: dict[str, SkinModel] | None = None,
) -> Generator[Progress, None, dict[int, SkinModel]]:
    """Make the skins of some fingers; yield progress.

    Fingers with equal parameters share one skin. A skin that cannot be made is left out.

    Args:
        scene: the scene's header.
        fingers: indices of the fingers.
        library: the presets.
        cache: cache of condensed skins; None to condense them anew.
        clock: run times. If there is any skin, later stages use a single BLAS thread.
        findings: list to which the reasons of left-out skins are appended.
        alike: skins that were made before, by their parameters, to which new ones are added; None for none.

    Returns:
        The skins by the index of the finger.
    """
    made: dict[int, SkinModel] = {}
    alike = {} if alike is None else alike
    for done, f in enumerate(sorted(fingers)):
        yield Progress("skin", done, len(fingers))
        from ..skin.finger_skin import finger_skin

        finger = scene.fingers[f]
        key = json.dumps([finger.parameters.get(name) for name in ("skin", "skin_level", "tissue")], sort_keys=True)
        try:
            with clock.stage("skin"):
                if key not in alike:
                    preset = library.skin(DEFAULT_SKIN)
                    alike[key] = finger_skin(finger.parameters, preset, cache=cache, where=f"finger '{finger.name}'")
                made[f] = alike[key]
        except DermisError as error:
            findings.append(unavailable(finger.name, error))
    if made:
        from ..skin.blas import one_thread

        clock.hold = one_thread
    return made


def touched(
    scene: TactileScene,
    chunks: Iterator[Chunk],
    models: Mapping[int, SkinModel],
    clock: Stages,
    kept: list[Chunk] | None = None,
    fingers: Collection[int] | None = None,
) -> Generator[Progress, None, tuple[PadContact, dict[int, SkinContact]]]:
    """Compute the contact of pads and of some skins; yield progress.

    The pads come first, because they replace invalid poses and surfaces. The skins get the repaired chunks.

    Args:
        scene: the scene's header.
        chunks: chunks of the scene.
        models: skins by the index of the finger.
        clock: run times.
        kept: list to which the repaired chunks are appended; None to drop them.
        fingers: indices of the fingers whose pads are sampled; None for all.

    Returns:
        Contact of the pads, and contact of the skins by the index of the finger.
    """
    from ..contact.pad_sampler import PadSampler

    pads, skins = PadSampler(scene, fingers), None
    if models:
        from ..contact.skin_sampler import SkinSampler

        skins = SkinSampler(scene, models)
    done = 0
    while True:
        with clock.stage("sampling"):
            chunk = next(chunks, None)
        if chunk is None:
            break
        with clock.stage("contact"):
            chunk = pads.add(chunk)
        if kept is not None:
            kept.append(chunk)
        if skins is not None:
            yield Progress("sampling", done, scene.sample_count)  # large meshes take seconds to prepare for each
            with clock.stage("skin contact"):
                skins.add(chunk)
        done += len(chunk.times)
        yield Progress("sampling", done, scene.sample_count)
    with clock.stage("contact"):
        pad_contact = pads.finish()
    return pad_contact, {} if skins is None else (yield from _balanced(skins, pad_contact, scene.sample_count, clock))


def felt_by(
    scene: TactileScene,
    chunks: Iterable[Chunk],
    models: Mapping[int, SkinModel],
    pad_contact: PadContact,
    clock: Stages,
) -> Generator[Progress, None, dict[int, SkinContact]]:
    """Compute the contact of some skins from chunks repaired by `touched`.

    The generator yields progress, and returns the contact by the index of the finger.
    """
    from ..contact.skin_sampler import SkinSampler

    skins, done = SkinSampler(scene, models), 0
    for chunk in chunks:
        with clock.stage("skin contact"):
            skins.add(chunk)
        done += len(chunk.times)
        yield Progress("skin contact", done, scene.sample_count)
    return (yield from _balanced(skins, pad_contact, scene.sample_count, clock))


def _balanced(
    skins: SkinSampler, pad_contact: PadContact, samples: int, clock: Stages
) -> Generator[Progress, None, dict[int, SkinContact]]:
    held = skins.solve_held(pad_contact)
    while True:
        with clock.stage("skin contact"):
            solved = next(held, None)
        if solved is None:
            return skins.finish()
        yield Progress("skin contact", solved, samples)
