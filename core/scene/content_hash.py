"""ContentHash: hash of a whole scene, and hashes of its parts.

The hashes do not depend on the division of the scene into chunks.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import feed
from .tactile_scene import SCENE_VERSION, Body, Chunk, TactileScene, header

Parts = dict[str, dict[str, str]]  # hashes by part, such as "object 'Table'", and by aspect, such as 'motion'


def said(what: Any) -> str:
    """Return the hash of plain values."""
    return hashlib.sha256(json.dumps(what, sort_keys=True, default=_plain).encode()).hexdigest()[:32]


def differences(before: Parts, now: Parts) -> list[str]:
    """Return texts on the parts of a scene that differ from before.

    The list is empty if all parts are equal. An object or screen that differs only in its name counts as equal. A
    finger with another name counts as another finger.

    Args:
        before: earlier hashes, see `ContentHash.parts`.
        now: present hashes.
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
    """A SHA-256 hash of a scene's header and of the chunks that pass.

    Each series of samples has its own hash, which is updated sample by sample. The result therefore does not depend on
    the samples at which chunks end.
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
        """Yield each chunk after it has been added to the hash."""
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
        """Return the hash of the header and of all chunks so far."""
        total = self._head.copy()
        for key in sorted(self._series):
            total.update(f"{key}={self._series[key].hexdigest()}\n".encode())
        return total.hexdigest()

    def parts(self) -> Parts:
        """Return hashes of all aspects of the scene's parts.

        The name of a part is in none of its hashes. Where a part refers to another, such as a device to the screen that
        it touches, the hash of the other part replaces its name.
        """
        scene, series = self._scene, self._grouped()
        meshes: dict[int, str] = {}  # by id, because instances share a mesh

        # A single hash is returned as it is, to save time: there may be ten thousand objects.
        def of(*groups: str) -> str:
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
        """Return names and hashes of the series of each part, by the part.

        A part is named by kind and index, such as 'channel/body/3'. The names of its series lack the index, because it
        may change when another object is renamed.
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
