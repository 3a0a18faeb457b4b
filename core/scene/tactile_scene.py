"""TactileScene: an animated scene as input of the engine, in SI units.

A scene is a header (names, parameters, meshes) and an iterable of chunks (poses over time). A chunk consists of arrays
only, and refers to fingers, bodies and screens by their index in the header.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError, Finding
from ..interpolate import MAX_SAMPLES
from ..parameters.device import DEVICE
from ..parameters.finger import FINGER
from ..parameters.material import BODY
from ..parameters.parameter import Table
from ..parameters.screen import SCREEN, SEQUENCE
from ..parameters.skin import SKIN, SKIN_CONTACT

SCENE_VERSION = 1


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles in its object's own space.

    Meshes are compared and hashed by identity, so that they can be keys of caches.

    Attributes:
        vertices: positions before the object's matrix [m], shape (V, 3).
        triangles: vertex indices, counter-clockwise seen from outside, shape (T, 3), int32.
    """

    vertices: Array
    triangles: NDArray[np.int32]

    def __repr__(self) -> str:
        return f"Mesh({len(self.vertices)} vertices, {len(self.triangles)} triangles)"


@dataclass(frozen=True)
class DeviceUse:
    """One use of a device by a finger.

    The finger wears the device, or the device acts on touch screens that the finger touches.

    Attributes:
        preset: file stem of the device preset, such as 'haptip'.
        parameters: settings of this use: switches and methods (SI or plain values).
        screen: name of the touch screen, for devices of screens; empty for all screens.
    """

    preset: str
    parameters: Mapping[str, Any] = field(default_factory=dict, repr=False)
    screen: str = ""


@dataclass(frozen=True)
class Finger:
    """A fingertip.

    Its origin is at the centre of the pad. +Y points towards the tip, +Z towards the nail.

    Attributes:
        name: unique among the scene's fingers.
        devices: devices in the order of the outputs.
        parameters: parameters of the fingertip and of touch (SI), constant over the scene.
    """

    name: str
    devices: tuple[DeviceUse, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict, repr=False)


@dataclass(frozen=True)
class Body:
    """A touchable object, or one instance of it.

    Attributes:
        name: unique among the scene's bodies.
        mesh: surface in the object's own space, for chunks that have no surface of the body; None if every chunk has
            one.
        parameters: haptic material and behaviour (SI), such as from `Library.material`. Animated parameters are in the
            chunks.
        content: names of bodies that this body contains, for [S3] eq. 5.
        simulated: whether a simulation moves the body, which is then sampled at whole frames.
    """

    name: str
    mesh: Mesh | None
    parameters: Mapping[str, Any] = field(default_factory=dict, repr=False)
    content: tuple[str, ...] = ()
    simulated: bool = False


# Surface of a body at samples at which it has none [m]: a triangle that is too far away to be touched.
ABSENT = Mesh(
    np.array([[1e6, 1e6, 1e6], [1e6 + 1.0, 1e6, 1e6], [1e6, 1e6 + 1.0, 1e6]]), np.array([[0, 1, 2]], np.int32)
)


@dataclass(frozen=True)
class Screen:
    """A touch screen.

    It is a rectangle in the XY plane of its object, with the object's origin at its centre. +Z points to the viewer.

    Attributes:
        name: unique among the scene's screens.
        size: width and height before the object's matrix [m].
        height_map: F, height towards the viewer, row 0 at the bottom (y = -height/2), shape (rows, columns). A sequence
            of maps has shape (maps, rows, columns). `parameters['sequence_start']` is then the scene frame of the first
            map, and `parameters['map_fps']` is the number of maps per second (without it, one map per frame).
        height_unit: metres per unit of the map; 0 if the map has no physical unit.
        parameters: settings of the rendering (SI or plain values).
        findings: repairs and warnings from reading the map.
        holes: pixels whose height was filled in because nothing was measured there, bool, shape of `height_map`; None
            without such pixels.
    """

    name: str
    size: tuple[float, float]
    height_map: NDArray[np.float32]
    height_unit: float = 0.0
    parameters: Mapping[str, Any] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    holes: NDArray[np.bool_] | None = None

    def __repr__(self) -> str:
        size = " x ".join(f"{1e3 * s:g}" for s in self.size)
        return f"Screen({self.name!r}, {size} mm, map {self.height_map.shape})"


@dataclass(frozen=True)
class Chunk:
    """Consecutive samples of everything that moves.

    Attributes:
        frames: scene frame of each sample, with fractions between frames, shape (n,).
        times: time since the start of the range [s], shape (n,).
        fingers, bodies, screens: object-to-world matrices [translation in m], shape (count, n, 4, 4).
        surfaces: surface of each deforming body at each sample, by the index of the body. Surfaces of the same topology
            share the array of triangles. A body with a surface in the header may deform in some chunks only.
        animated: animated parameters, shape (n,), by keys such as 'finger/0/pattern_play' and 'body/3/friction'. A
            chunk that lacks a parameter has the header's value of it.
    """

    frames: Array
    times: Array
    fingers: Array
    bodies: Array
    screens: Array
    surfaces: Mapping[int, tuple[Mesh, ...]] = field(default_factory=dict)
    animated: Mapping[str, Array] = field(default_factory=dict)

    def __repr__(self) -> str:
        moving = ", ".join(f"{len(getattr(self, name))} {name}" for name in ("fingers", "bodies", "screens"))
        return f"Chunk({len(self.times)} samples, {moving})"


@dataclass(frozen=True)
class TactileScene:
    """A sampled scene: the header, and the chunks in order of time.

    Attributes:
        name: name for messages and files.
        fingers, bodies, screens: the objects of the scene; chunks refer to them by their index.
        fps: frames per second as an exact fraction (29.97 is 30000/1001).
        frame_range: first and last frame, both included.
        rate: samples per second [Hz].
        chunks: iterable of `Chunk`. It may be a generator that samples the scene while it is read, and can be read only
            once.
        gravity: acceleration of gravity in world space [m/s^2], shape (3,).
        findings: findings from the sampling of the scene.
    """

    name: str
    fps: Fraction
    frame_range: tuple[int, int]
    rate: float
    fingers: tuple[Finger, ...]
    bodies: tuple[Body, ...]
    screens: tuple[Screen, ...]
    chunks: Iterable[Chunk]
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    findings: tuple[Finding, ...] = ()

    def __repr__(self) -> str:
        first, last = self.frame_range
        holds = ", ".join(f"{len(getattr(self, name))} {name}" for name in ("fingers", "bodies", "screens"))
        return (
            f"TactileScene({self.name!r}, frames {first} to {last}, {self.duration:g} s at {self.rate:g} Hz, {holds})"
        )

    @property
    def duration(self) -> float:
        """Length of the range [s]."""
        return float((self.frame_range[1] - self.frame_range[0]) / self.fps)

    @property
    def sample_count(self) -> int:
        """Number of samples of the whole range, both ends included."""
        return sample_count(self.fps, self.frame_range, self.rate)

    def validate(self) -> None:
        """Refuse a scene that cannot be rendered.

        Raises:
            DermisError: the scene has no finger or nothing to touch, its range has no duration, its rate or gravity is
                no physical value, two fingers, two bodies or two screens have the same name, a parameter is out of
                range, or a mesh is damaged, see `check_mesh`.
        """
        validate(self)


def device_times(scene: TactileScene, rate: float) -> Array:
    """Return the times of a device's commands over a scene's range [s].

    The times are multiples of 1 / `rate`, at any number of frames per second. The shape is (n,).
    """
    return np.arange(sample_count(scene.fps, scene.frame_range, rate)) / rate


def sample_count(fps: Fraction, frame_range: tuple[int, int], rate: float) -> int:
    """Return the number of samples of a range.

    The first sample is at the start of the range, the last one at its end or less than 1 / `rate` before it.

    Args:
        fps: frames per second.
        frame_range: first and last frame.
        rate: samples per second [Hz].

    Raises:
        DermisError: `fps` or `rate` is not above zero, or a track cannot hold as many samples.
    """
    if not (fps > 0 and np.isfinite(rate) and rate > 0):
        raise DermisError(
            "the frame rate and the rate of samples must be above zero",
            where="scene",
            value=f"{float(fps):g} and {rate:g}",
            limit="> 0 Hz",
        )
    if (frame_range[1] - frame_range[0]) / fps * Fraction(rate) > MAX_SAMPLES:
        raise DermisError(
            "the range has more samples than a track can hold",
            where="scene",
            value=f"frames {frame_range[0]} to {frame_range[1]}",
            limit=f"{MAX_SAMPLES} samples",
            remedy="Shorten the range",
        )
    duration = Fraction(frame_range[1] - frame_range[0]) / fps
    return int(duration * Fraction(rate).limit_denominator(1_000_000)) + 1


def sample_frames(fps: Fraction, frame_range: tuple[int, int], rate: float) -> tuple[Array, Array]:
    """Return the scene frames and the times [s] of the samples of a range.

    Both have shape (n,). The times are multiples of 1 / `rate`, at any number of frames per second. Frames within 1e-9
    of a whole frame are exactly whole.
    """
    n = sample_count(fps, frame_range, rate)
    times = np.arange(n) / rate
    frames = frame_range[0] + times * float(fps)
    whole = np.rint(frames)
    return np.where(np.abs(frames - whole) < 1e-9, whole, frames), times


def constant(scene: TactileScene, key: str) -> float:
    """Return the header's value of a parameter that a chunk does not animate.

    Args:
        scene: the scene's header.
        key: key of the parameter as in `Chunk.animated`, such as 'body/3/friction'.

    Raises:
        DermisError: the header has no number of this key.
    """
    kind, _, rest = key.partition("/")
    places, _, name = rest.rpartition("/")
    table = {"finger": FINGER, "body": BODY, "screen": SCREEN, "device": DEVICE}.get(kind, {})
    try:
        first, *more = map(int, places.split("/"))
        owners = {"finger": scene.fingers, "body": scene.bodies, "screen": scene.screens, "device": scene.fingers}
        owner: Any = owners[kind][first]
        owner = owner.devices[more[0]] if kind == "device" else owner
        return float(owner.parameters.get(name, table[name].absent))
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise DermisError(
            "an animated value is missing from some of the chunks, and the header has none",
            where=key,
            remedy="Give it in every chunk, or among the parameters of its owner",
        ) from error


def unknown_settings(scene: TactileScene) -> Iterator[Finding]:
    """Yield a warning for each parameter whose name is no setting.

    Otherwise a misspelt parameter would be ignored silently.
    """
    finger = {**FINGER, **SKIN_CONTACT, "skin": None}
    groups: list[tuple[str, Mapping[str, Any], Iterable[str]]] = []
    for one in scene.fingers:
        groups.append((f"finger '{one.name}'", one.parameters, finger))
        if isinstance(skin := one.parameters.get("skin"), Mapping):
            groups.append((f"skin of finger '{one.name}'", skin, SKIN))
        groups += [(f"device '{use.preset}' of finger '{one.name}'", use.parameters, DEVICE) for use in one.devices]
    groups += [(f"object '{body.name}'", body.parameters, BODY) for body in scene.bodies]
    groups += [(f"screen '{screen.name}'", screen.parameters, {**SCREEN, **SEQUENCE}) for screen in scene.screens]
    judged: set[int] = set()  # instances share their parameters, which are checked once
    for where, given, known in groups:
        names = () if id(given) in judged else given
        judged.add(id(given))
        for name in names:
            if name not in known:
                yield Finding(
                    "warning",
                    "unknown-setting",
                    "no setting has this name, so its value does nothing",
                    where=where,
                    value=name,
                    limit=" or ".join(get_close_matches(name, known)),
                    remedy="Correct the name, see core/PARAMETERS.md, or remove it",
                )


def validate(scene: TactileScene) -> None:
    """See `TactileScene.validate`."""
    where = f"scene '{scene.name}'"
    if not scene.fingers:
        raise DermisError("no finger", where=where, remedy="Add one with Add > Dermis > Finger", code="no-finger")
    patterned = any(FINGER["pattern"].of(f.parameters, f"finger '{f.name}'") != "none" for f in scene.fingers)
    if not scene.bodies and not scene.screens and not patterned:
        raise DermisError(
            "nothing to touch",
            where=where,
            remedy="Select an object and press Make Touchable, or add a touch screen",
            code="nothing-to-touch",
        )
    first, last = scene.frame_range
    if last <= first:
        raise DermisError(
            "the frame range has no duration",
            where=where,
            value=f"{first} to {last}",
            limit="an end frame after the start frame",
            remedy="Set the range in the Output properties",
        )
    if np.shape(scene.gravity) != (3,) or not np.isfinite(scene.gravity).all():
        raise DermisError("gravity must be an acceleration", where=where, value=scene.gravity, limit="3 finite numbers")
    if not (np.isfinite(scene.rate) and scene.rate > 0):
        raise DermisError("the sampling rate must be positive", where=where, value=scene.rate, limit="> 0 Hz")
    groups: tuple[tuple[str, Any, Table], ...] = (
        ("finger", scene.fingers, FINGER),
        ("object", scene.bodies, BODY),
        ("screen", scene.screens, {**SCREEN, **SEQUENCE}),
    )
    for kind, items, table in groups:
        judged: set[int] = set()  # instances share their parameters, which are checked once
        # Devices and skins are checked when they are rendered, so that an error of one does not stop the others.
        for item in items:
            if id(item.parameters) not in judged:
                judged.add(id(item.parameters))
                for row in table.values():
                    row.of(item.parameters, f"{kind} '{item.name}'")
        for name, times in sorted(Counter(item.name for item in items).items()):
            if times > 1:
                raise DermisError(
                    f"two {kind}s have the same name", where=where, value=name, remedy="Rename one of them"
                )
    # Instances share meshes, which are checked once.
    for mesh, name in {body.mesh: body.name for body in reversed(scene.bodies)}.items():
        if mesh is not None:
            check_mesh(mesh, f"object '{name}'")


def check_mesh(mesh: Mesh, where: str) -> None:
    """Refuse an empty or damaged surface.

    Raises:
        DermisError: the mesh has no faces, its vertices are not finite, or its triangles are not indices of its
            vertices.
    """
    if len(mesh.vertices) == 0 or len(mesh.triangles) == 0:
        raise DermisError("the mesh has no faces", where=where, remedy="Give it faces, or stop it being touchable")
    if not np.isfinite(mesh.vertices).all():
        wrong = np.flatnonzero(~np.isfinite(mesh.vertices).all(axis=1))
        raise DermisError(
            "the mesh has vertices that are not finite numbers",
            where=where,
            value=f"{len(wrong)} of {len(mesh.vertices)}; vertex {wrong[0]} is at {mesh.vertices[wrong[0]].tolist()}",
            limit="finite numbers",
            remedy="Remove these vertices, or look at the shape keys and modifiers that move them",
        )
    if mesh.triangles.dtype.kind not in "iu":
        raise DermisError("triangles must be indices of vertices", where=where, value=str(mesh.triangles.dtype))
    if mesh.triangles.min() < 0 or mesh.triangles.max() >= len(mesh.vertices):
        raise DermisError(
            "a face uses a vertex that does not exist",
            where=where,
            value=int(mesh.triangles.max()),
            limit=f"0 to {len(mesh.vertices) - 1}",
        )


def header(scene: TactileScene) -> dict[str, Any]:
    """Return everything but arrays and findings, as JSON values.

    The result is part of the content hash and of scene files.
    """
    return {
        "version": SCENE_VERSION,
        "name": scene.name,
        "fps": [scene.fps.numerator, scene.fps.denominator],
        "frame_range": list(scene.frame_range),
        "rate": scene.rate,
        "gravity": list(scene.gravity),
        "fingers": [
            {
                "name": f.name,
                "parameters": dict(f.parameters),
                "devices": [
                    {"preset": d.preset, "parameters": dict(d.parameters), "screen": d.screen} for d in f.devices
                ],
            }
            for f in scene.fingers
        ],
        "bodies": [
            {
                "name": b.name,
                "parameters": dict(b.parameters),
                "content": list(b.content),
                "simulated": b.simulated,
                "deforming": b.mesh is None,
            }
            for b in scene.bodies
        ],
        "screens": [
            {"name": s.name, "size": list(s.size), "height_unit": s.height_unit, "parameters": dict(s.parameters)}
            for s in scene.screens
        ],
    }
