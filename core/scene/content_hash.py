"""Hashes of what a scene contains, whole and thing by thing, blind to how it was cut into chunks."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import feed
from .tactile_scene import SCENE_VERSION, Chunk, TactileScene, header

Parts = dict[str, dict[str, str]]


def said(what: Any) -> str:
    """Return the hash of plain values."""
    return hashlib.sha256(json.dumps(what, sort_keys=True, default=_plain).encode()).hexdigest()[:32]


def differences(before: Parts, now: Parts) -> list[str]:
    """Return in words how the parts of a scene differ from what they were; empty where nothing does.

    Objects and screens may have other names: what is all the same under another name is the same thing. Fingers are
    those of their names.
    """
    left = {name: aspects for name, aspects in before.items() if now.get(name) != aspects}
    new = {name: aspects for name, aspects in now.items() if before.get(name) != aspects}
    for name in [name for name in left if not name.startswith(("finger ", "scene"))]:
        kind = name.partition(" ")[0]
        same = next((n for n, aspects in new.items() if aspects == left[name] and n.startswith(f"{kind} ")), None)
        if same is not None:
            del left[name], new[same]
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

        What one thing is to another, such as the screen that a device touches, goes in by that other one's hash.
        """
        scene = self._scene
        screens = {s.name: self._screen(i) for i, s in enumerate(scene.screens)}
        bodies = {b.name: self._body(i) for i, b in enumerate(scene.bodies)}
        inside = {name: said(bodies[name]) for name in bodies}
        found: Parts = {
            "scene": {
                "frames": said([str(scene.fps), scene.frame_range, self._of_all("frames", "times")]),
                "sampling rate": said(scene.rate),
                "gravity": said(scene.gravity),
            }
        }
        for i, finger in enumerate(scene.fingers):
            uses = [[u.preset, u.parameters, said(screens.get(u.screen, u.screen))] for u in finger.devices]
            found[f"finger '{finger.name}'"] = {
                "settings": said(finger.parameters),
                "devices": said(uses),
                "motion": self._of_all(f"finger/{i} "),
                "keyed settings": self._of_all(f"channel/finger/{i}/", f"channel/device/{i}/"),
            }
        for body in scene.bodies:
            content = sorted(inside.get(name, "") for name in body.content)
            found[f"object '{body.name}'"] = {**bodies[body.name], "content": said(content)}
        found.update({f"screen '{name}'": aspects for name, aspects in screens.items()})
        return found

    def _body(self, i: int) -> dict[str, str]:
        body, shape = self._scene.bodies[i], hashlib.sha256()
        if body.mesh is not None:
            feed(shape, body.mesh.vertices, body.mesh.triangles)
        return {
            "settings": said([body.parameters, body.simulated]),
            "shape": said([shape.hexdigest(), self._of_all(f"surface/{i}\n")]),
            "motion": self._of_all(f"body/{i} "),
            "keyed settings": self._of_all(f"channel/body/{i}/"),
        }

    def _screen(self, i: int) -> dict[str, str]:
        screen, relief = self._scene.screens[i], hashlib.sha256()
        feed(relief, screen.height_map)
        return {
            "settings": said([screen.parameters, screen.size, screen.height_unit]),
            "relief": relief.hexdigest(),
            "motion": self._of_all(f"screen/{i} "),
            "keyed settings": self._of_all(f"channel/screen/{i}/"),
        }

    def _of_all(self, *starts: str) -> str:
        """Return a hash of all series whose names begin so; a newline ends each name."""
        mine = {key: series for key, series in self._series.items() if f"{key}\n".startswith(starts)}
        # a keyed setting is named after its thing's number, which another name may change
        return said([[key.split("/", 3)[3:], mine[key].hexdigest()] for key in sorted(mine)])

    def _add(self, key: str, rows: NDArray[Any]) -> None:
        self._of(f"{key} {rows.dtype.str}{rows.shape[1:]}").update(np.ascontiguousarray(rows).data)

    def _of(self, key: str) -> Any:
        if key not in self._series:
            self._series[key] = hashlib.sha256()
        return self._series[key]
