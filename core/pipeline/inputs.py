"""Hashes of the single inputs of a bake, to compare them with a scene."""

from __future__ import annotations

from collections.abc import Generator

from ..presets import Library
from ..scene.content_hash import ContentHash, Parts, differences, said
from ..scene.tactile_scene import TactileScene
from .kept_shares import device_sources

__all__ = ["differences", "inputs_of", "sampled"]


def inputs_of(scene: TactileScene, content: ContentHash, library: Library) -> Parts:
    """Return the hashes of a scene's inputs: its objects and the presets.

    The entry of each finger also has one hash of its devices' presets and of the files that their settings name.

    Args:
        scene: the scene's header.
        content: hash of the scene, through which all chunks have passed.
        library: the presets.
    """
    found = content.parts()
    for finger in scene.fingers:
        sources = [device_sources(use, library) for use in finger.devices]
        found[f"finger '{finger.name}'"]["presets of its devices"] = said(sources)
    return found


def sampled(scene: TactileScene, library: Library) -> Generator[None, None, Parts]:
    """Read a scene's chunks, and return the hashes of its inputs.

    The generator yields after each chunk.
    """
    content = ContentHash(scene)
    for _ in content.through(scene.chunks):
        yield
    return inputs_of(scene, content, library)
