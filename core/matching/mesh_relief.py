"""Mesh relief: friction from the surface normals of touched objects, without a height map.

Objects may have any shape, move and deform. The formula is the form of eq. 6 that agrees with height maps,
f = -f0 n_xy . v / n_z. With `relief_formula` 'printed' it is the form that the paper prints, f = f0 n . [v, 0], whose
sign is opposite. The normal n is that of the curved surface which the mesh approximates, at the point closest to the
pad. The direction of motion v and the normal are given in the axes of the screen under the finger. Without a screen
they are given in the finger's own axes, x and y along the pad, and v is the motion over the object's material. A finger
whose pad stays parallel to the surface then feels nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..contact.encounter import Encounter, turned, turned_back
from ..contact.holding_times import meet
from ..devices.friction_screen import FrictionScreen
from ..devices.spec import DeviceSpec
from ..effects.slide import (
    MAX_FRICTION,
    STEEPEST_NORMAL,
    directions,
    friction_of_normal,
    friction_of_normal_printed,
    without_downhill,
)
from ..errors import DermisError, Finding
from ..scene.tactile_scene import DeviceUse, TactileScene
from ..track.command_track import CommandTrack
from .rendered import Rendered
from .screen_path import Settings, driven_values, scale_findings, screen_path, screens_of

if TYPE_CHECKING:
    from ..contact.pad_contact import PadContact


def render(pad_contact: PadContact, scene: TactileScene, finger: int, use: DeviceUse, spec: DeviceSpec) -> Rendered:
    """Render a friction screen from the surface normals along one finger's path.

    The pad touches an object within the finger's `touch_distance`. If the scene has screens, the pad must also be over
    one of them. Of several objects, the nearest counts. With the automatic scale, the steepest slope that the finger
    meets during the whole bake becomes friction 100. The only profile is 'slope'.

    Raises:
        DermisError: the profile, the formula, the scale mode or the downhill mode is unknown, the scale is zero, or the
            screen does not exist.

    Source: [S4] eq. 6, as printed or with the sign and the division that make it equal to eq. 5
    """
    device = FrictionScreen.of(spec)
    where = f"finger '{scene.fingers[finger].name}', {spec.name}"
    settings = Settings(pad_contact, scene, finger, use, spec.rate, where)
    mode, downhill, formula = _checked(settings, where)
    times, n = settings.times, len(settings.times)
    met = [(b, m) for b in range(len(scene.bodies)) if (m := meet(pad_contact, scene, finger, b, times)) is not None]
    gaps = np.array([np.where(m.touching, m.gap, np.inf) for _, m in met]).reshape(len(met), n)
    contact: NDArray[np.bool_] = np.isfinite(gaps).any(axis=0)
    chosen = gaps.argmin(axis=0) if met else np.zeros(n, dtype=np.intp)

    names = ("x", "y", "distance", "direction_x", "direction_y", "grad_x", "grad_y", "height", "friction")
    signals = {name: np.zeros(n) for name in names}
    findings: list[Finding] = []
    normal = np.zeros((n, 3))
    screen = np.full(n, -1.0)
    resting: NDArray[np.bool_] | None = None
    if scene.screens:
        relevant = screens_of(scene, use)
        paths = [screen_path(pad_contact, scene, finger, s, settings) for s in relevant]
        over = np.array([np.where(p.inside, np.abs(p.z), np.inf) for p in paths])
        nearest = np.argmin(over, axis=0)
        contact &= np.isfinite(over).any(axis=0)
        resting = np.zeros(n, dtype=bool)
        for place, (s, path) in enumerate(zip(relevant, paths, strict=True)):
            mine = nearest == place
            signals["x"][mine], signals["y"][mine], resting[mine] = path.x[mine], path.y[mine], path.resting[mine]
            screen[mine & contact] = s
            if settings.told:
                findings += scale_findings(pad_contact.screens[s], scene.screens[s].name)
            linear = pad_contact.screens[s][:, :3, :3]
            axes = linear / np.linalg.norm(linear, axis=1)[:, None, :]
            for k, (b, m) in enumerate(met):
                local = np.einsum("nij,ni->nj", axes, _smooth_normals(pad_contact, finger, b))
                _put(normal, m.between(local), m, mine & contact & (chosen == k))
    else:
        pads = pad_contact.finger_at(finger, pad_contact.times)
        for k, (b, m) in enumerate(met):
            local = turned_back(pads, slice(None), _smooth_normals(pad_contact, finger, b))
            _put(normal, m.between(local), m, contact & (chosen == k))
            steps = np.zeros((n, 3))
            _put(steps, _velocity(pad_contact, finger, m), m, contact & (chosen == k))
            signals["x"] += np.cumsum(steps[:, 0]) / spec.rate
            signals["y"] += np.cumsum(steps[:, 1]) / spec.rate
        with settings.carry("way") as carry:
            way = np.stack([signals["x"], signals["y"]])
            way += 0.0 if carry.start is None else (carry.start - way[:, 0])[:, None]
            carry.found, (signals["x"], signals["y"]) = way[:, carry.index], way
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    window = float(settings.constant("direction_window"))
    with settings.carry("heading") as carry:
        direction = directions(signals["x"], signals["y"], contact, spec.rate, window, resting, carry=carry)
    slopes = -normal[contact, :2] / np.maximum(normal[contact, 2:], STEEPEST_NORMAL)
    if formula == "printed":
        signed, limited = friction_of_normal_printed(normal[contact], direction[contact], 1.0), 0
        scale = _scale(settings, mode, normal[contact, :2], contact, where)
    else:
        signed, limited = friction_of_normal(normal[contact], direction[contact], 1.0)
        scale = _scale(settings, mode, slopes, contact, where)
    signals["friction"][contact] = without_downhill(signed * scale, downhill)
    signals["direction_x"], signals["direction_y"] = direction.T
    signals["grad_x"][contact], signals["grad_y"][contact] = slopes.T
    signals["distance"][contact] = gaps.min(axis=0, initial=np.inf)[contact]

    if not contact.any():
        findings.append(
            Finding(
                "warning",
                "never-touches",
                "the finger never touches an object",
                where=where,
                remedy="Bring the pad to a touchable object, or raise its touch distance",
            )
        )
    if limited:
        findings.append(
            Finding(
                "info",
                "too-steep",
                "the surface is too steep for the screen; its slope is limited",
                where=where,
                limit=f"n_z >= {STEEPEST_NORMAL:g}",
                count=limited,
            )
        )
    values, driven = driven_values(signals["friction"], settings, device, spec, where)
    signals = {"contact": contact.astype(np.float64), "screen": screen, **signals}
    law = device.law
    meta = {
        "relief": "mesh",
        "relief_formula": formula,
        "screen": ", ".join(s.name for i, s in enumerate(scene.screens) if (screen == i).any()),
        "downhill": downhill,
        "scale": f"{float(np.max(scale, initial=0.0)):.9g}",
        "law": f"slope {law.slope:.9g} intercept {law.intercept:.9g} base {law.base:.9g}",
    }
    track = CommandTrack(spec, times, values, meta)
    skipped = {"slopes_untouched": int((~contact).sum())}
    return Rendered(track, signals, (*findings, *driven), skipped)


def _checked(settings: Settings, where: str) -> tuple[str, str, str]:
    """Return the scale mode, the downhill mode and the formula."""
    profile = settings.constant("profile")
    if profile != "slope":
        raise DermisError("this profile is not available for a mesh", where=where, value=profile, limit="slope")
    return settings.constant("scale_mode"), settings.constant("downhill"), settings.constant("relief_formula")


def _scale(settings: Settings, mode: str, slopes: Array, contact: NDArray[np.bool_], where: str) -> float | Array:
    """Return the scale f0, one value or one for each touching time, shape (k,).

    Args:
        settings: settings of the use.
        mode: 'auto' or 'manual'.
        slopes: vectors by which the direction of motion is multiplied, shape (k, 2).
        contact: whether the finger touches, shape (n,).
        where: for errors.
    """
    if mode == "auto":
        steepest = float(np.linalg.norm(slopes, axis=1).max(initial=0.0))
        with settings.carry("steepest") as carry:
            carry.found = steepest = max(steepest, carry.start or 0.0)
        return MAX_FRICTION / steepest if steepest > 1e-12 else 0.0
    manual = settings.series("scale")
    if manual is None or not np.isfinite(manual).all() or not manual.any():
        raise DermisError("the scale must not be zero", where=where, remedy="Choose the automatic scale")
    return manual[contact]


def _smooth_normals(pad_contact: PadContact, finger: int, body: int) -> Array:
    """Return the smooth normals at all samples in world axes, shape (n, 3)."""
    normals = pad_contact.pairs[finger, body].smooth_normal
    if normals is None:
        raise DermisError("the touch was sampled without the normals of its surfaces", where=f"finger {finger}")
    return normals


def _velocity(pad_contact: PadContact, finger: int, met: Encounter) -> Array:
    """Return the pad's velocity over the material in the finger's axes at the touching times [m/s], shape (k, 3)."""
    world = turned(pad_contact.body_at(met.body, met.times), met.which, met.velocity)
    return turned_back(pad_contact.finger_at(finger, met.times), met.which, world)


def _put(target: Array, values: Array, met: Encounter, where: NDArray[np.bool_]) -> None:
    """Write values of an encounter's touching times, shape (k, 3), to those times at which `where` is true."""
    full = np.zeros_like(target)
    full[met.which] = values
    target[where] = full[where]
