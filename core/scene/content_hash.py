"""Hashes of a scene's contents, whole and thing by thing, blind to how it was cut into chunks."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import feed
from .tactile_scene import SCENE_VERSION, Body, Chunk, TactileScene, header

Parts = dict[str, dict[str, str]]


def said(what: Any) -> str:
    """Return the hash of plain values."""
    return hashlib.sha256(json.dumps(what, sort_keys=True, default=_plain).encode()).hexdigest()[:32]


def differences(before: Parts, now: Parts) -> list[str]:
    """Return in words how the parts of a scene differ from their earlier state; empty if they are equal.

    Objects and screens may have other names: an object that differs by its name alone is the same. Fingers are
    those of their names.
    """
    left = {name: aspects for name, aspects in before.items() if now.get(name) != aspects}
    new = {name: aspects for name, aspects in now.items() if before.get(name) != aspects}
    alike: dict[tuple[str, str], list[str]] = {}
    for name, aspects in new.items():
        alike.setdefault((name.partition(" ")[0], said(aspects)), []).append(name)
    for name in [name for name in left if not name.startswith(("finger ", "scene"))]:
        same = alike.get((name.partition(" ")[0], said(left[name])))
        if same:
            del left[name], new[same.pop()]
    found = []
    for name in sorted({*left, *new}):
        if name not in new:
            found.append(f"{name} is not there any more")
        elif name not in left:
            found.append(f"{name} is new")
        else:
            aspects = {**left[name], **new[name]}
            found.append(f"{name}: {', '.join(a for a in aspects if left[name].get(a) != new[name].get(a))}")
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return dict(value)
    return value.item() if isinstance(value, np.generic) else str(value)


class ContentHash:
    """A running SHA-256 over a scene's header and, as they pass, its chunks.

    Each series has a hash of its own, fed sample by sample, so that the result does not depend on where one chunk ends
    and the next begins.
    """

    def __init__(self, scene: TactileScene) -> None:
        self._head = hashlib.sha256(f"dermis-scene {SCENE_VERSION}\n".encode())
        self._head.update(json.dumps(header(scene), sort_keys=True).encode())
        for body in scene.bodies:
            if body.mesh is not None:
                feed(self._head, body.mesh.vertices, body.mesh.triangles)
        for screen in scene.screens:
            feed(self._head, screen.height_map, *(() if screen.holes is None else (screen.holes,)))
        self._series: dict[str, Any] = {}
        self._scene = scene

    def through(self, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
        """Pass chunks on, adding each to the hash."""
        for chunk in chunks:
            self._add("frames", chunk.frames)
            self._add("times", chunk.times)
            for kind, poses in (("finger", chunk.fingers), ("body", chunk.bodies), ("screen", chunk.screens)):
                for index, pose in enumerate(poses):
                    self._add(f"{kind}/{index}", pose)
            for key, values in chunk.animated.items():
                self._add(f"channel/{key}", values)
            for index, meshes in chunk.surfaces.items():
                series = self._of(f"surface/{index}")
                for mesh in meshes:
                    feed(series, mesh.vertices, mesh.triangles)
            yield chunk

    def hexdigest(self) -> str:
        """Return the hash of everything so far."""
        total = self._head.copy()
        for key in sorted(self._series):
            total.update(f"{key}={self._series[key].hexdigest()}\n".encode())
        return total.hexdigest()

    def parts(self) -> Parts:
        """Return the hash of each aspect of each thing, under the thing's name; names themselves are no part of them.

        The relation of two objects, such as the screen that a device touches, goes in by that other one's hash.
        """
        scene, series = self._scene, self._grouped()
        meshes: dict[int, str] = {}  # instances share one

        def of(*groups: str) -> str:  # plain texts, since there may be ten thousand of them
            rows = [sorted(series.get(group, ())) for group in groups]
            if len(rows) == len(rows[0]) == 1 and not rows[0][0][0]:
                return rows[0][0][1]
            return said(rows) if any(rows) else ""

        def shape(body: Body) -> str:
            if body.mesh is None:
                return ""
            if id(body.mesh) not in meshes:
                sha = hashlib.sha256()
                feed(sha, body.mesh.vertices, body.mesh.triangles)
                meshes[id(body.mesh)] = sha.hexdigest()
            return meshes[id(body.mesh)]

        bodies = [
            {
                "settings": said([body.parameters, body.simulated]),
                "shape": f"{shape(body)}{of(f'surface/{i}')}",
                "motion": of(f"body/{i}"),
                "keyed settings": of(f"channel/body/{i}"),
            }
            for i, body in enumerate(scene.bodies)
        ]
        screens = {}
        for i, screen in enumerate(scene.screens):
            relief = hashlib.sha256()
            feed(relief, screen.height_map)
            screens[screen.name] = {
                "settings": said([screen.parameters, screen.size, screen.height_unit]),
                "relief": relief.hexdigest(),
                "motion": of(f"screen/{i}"),
                "keyed settings": of(f"channel/screen/{i}"),
            }
        held = {name for body in scene.bodies for name in body.content}
        inside = {b.name: said(own) for b, own in zip(scene.bodies, bodies, strict=True) if b.name in held}
        found: Parts = {
            "scene": {
                "frames": said([str(scene.fps), scene.frame_range, of("frames", "times")]),
                "sampling rate": said(scene.rate),
                "gravity": said(scene.gravity),
            }
        }
        for i, finger in enumerate(scene.fingers):
            uses = [[u.preset, u.parameters, said(screens.get(u.screen, u.screen))] for u in finger.devices]
            found[f"finger '{finger.name}'"] = {
                "settings": said(finger.parameters),
                "devices": said(uses),
                "motion": of(f"finger/{i}"),
                "keyed settings": of(f"channel/finger/{i}", f"channel/device/{i}"),
            }
        for body, aspects in zip(scene.bodies, bodies, strict=True):
            content = sorted(inside.get(name, "") for name in body.content)
            found[f"object '{body.name}'"] = {**aspects, "content": said(content) if content else ""}
        found.update({f"screen '{name}'": aspects for name, aspects in screens.items()})
        return found

    def _grouped(self) -> dict[str, list[tuple[str, str]]]:
        """Return name and hash of each series of each thing, such as of 'channel/body/3'.

        A thing's number is no part of the name: another name may change it.
        """
        found: dict[str, list[tuple[str, str]]] = {}
        for key, series in self._series.items():
            words = key.partition(" ")[0].split("/")
            own = 3 if words[0] == "channel" else 2
            found.setdefault("/".join(words[:own]), []).append(("/".join(words[own:]), series.hexdigest()))
        return found

    def _add(self, key: str, rows: NDArray[Any]) -> None:
        self._of(f"{key} {rows.dtype.str}{rows.shape[1:]}").update(np.ascontiguousarray(rows).data)

    def _of(self, key: str) -> Any:
        if key not in self._series:
            self._series[key] = hashlib.sha256()
        return self._series[key]
