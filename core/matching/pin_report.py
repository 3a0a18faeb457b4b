"""Comparison of the six matching methods of pin arrays for one scene.

On the mesh with which the commands were computed, DM2 has the least error by construction, so that its error only
verifies the solver. A finer mesh gives independent evidence: contact is solved again on it for the target, and the pins
press with the commands of the coarser mesh. Both errors are reported.

Source: [S1] eq. 20 and 21
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..contact.skin_contact import SkinContact
from ..contact.skin_sampler import skin_contacts
from ..devices.spec import DeviceSpec
from ..errors import DermisError, Finding
from ..parameters.device import DEVICE
from ..parameters.skin import DEFAULT_SKIN, SKIN_CONTACT
from ..presets import Library
from ..scene.tactile_scene import TactileScene
from ..skin.finger_skin import finger_skin
from ..skin.model import SkinModel
from . import pin_resolution
from .deformation import METHODS, Method
from .pins import Matched, PinSetup, Weighting, make_solver, match, setup


@dataclass(frozen=True)
class MethodReport:
    """Errors of one method over one scene; they are RMS values over the frames in contact.

    Attributes:
        method: the method.
        displacement_error, displacement_peak: u_err, and its largest value in a frame [m].
        displacement_share: u_err divided by the norm of the target's displacement.
        force_error: f_err [N].
        shear_ratio, target_ratio: ratio of the RMS tangential force to the RMS normal force, of pins and target.
        normal_force, target_normal: RMS force along the pad's normal, of pins and target [N].
        at_limit: largest number of pins at their limit in a frame.
        kkt: largest KKT residual of DM2 and FM2.
        finer_error, finer_share: u_err [m] of the commands on a finer mesh, and its share of the target; NaN without
            one.
        stress_share: error of the whole stress of the skin, relative to the target's.
    """

    method: Method
    displacement_error: float
    displacement_peak: float
    displacement_share: float
    force_error: float
    shear_ratio: float
    target_ratio: float
    normal_force: float
    target_normal: float
    at_limit: int
    kkt: float
    finer_error: float = float("nan")
    finer_share: float = float("nan")
    stress_share: float = float("nan")


class SceneReports(NamedTuple):
    """Reports of all methods for the fingers of a scene that wear a pin array and touch something.

    Attributes:
        reports: reports by the names of finger and device.
        findings: fingers that were left out, and doubts about the resolution.
    """

    reports: dict[str, tuple[MethodReport, ...]]
    findings: tuple[Finding, ...]


def compare(
    skin: SkinContact,
    spec: DeviceSpec,
    *,
    methods: Sequence[Method] = METHODS,
    weighting: Weighting = "all",
    bounded: bool = True,
    finer: SkinContact | None = None,
    where: str = "",
) -> tuple[MethodReport, ...]:
    """Compare matching methods for the touch of one finger's skin.

    Args:
        skin: touch on the mesh with which commands are computed.
        spec: preset of the pin array.
        methods: methods to compare.
        weighting: which nodes are compared, see `pins.setup`.
        bounded: whether the limits of pin forces apply.
        finer: touch of the same scene on a finer mesh of the same finger.
        where: name of the finger, for errors.

    Returns:
        One report for each method.

    Raises:
        DermisError: nothing was touched, the mesh of `finer` is not finer, or its times are those of another scene.
    """
    where = where or spec.name
    if not len(skin.contact):
        raise DermisError("nothing was touched, so there is nothing to compare", where=where)
    if finer is not None:
        if not np.array_equal(finer.times, skin.times):
            raise DermisError("the finer skin belongs to another scene", where=where, value=len(finer.times))
        if not len(finer.contact):
            raise DermisError("the finer skin touched nothing, so there is nothing to compare", where=where)
        _finer(skin.model.mesh.free.size, finer.model.mesh.free.size, where)
    ready = setup(skin.model, spec, weighting)
    size = _target_size(ready, skin)
    fine_ready = None if finer is None else setup(finer.model, spec, weighting)
    reports = []
    for method in methods:
        matched = match(make_solver(ready, spec, method, skin.times, bounded=bounded), skin)
        fine, fine_size = float("nan"), 1.0
        if finer is not None and fine_ready is not None:
            fine = _rms(error_on(fine_ready, finer, matched)[finer.contact])
            fine_size = _target_size(fine_ready, finer)
        reports.append(_report(method, matched, ready, skin, size, fine, fine / fine_size))
    return tuple(reports)


def compare_scene(scene: TactileScene, library: Library, *, finer: str = "") -> SceneReports:
    """Compare all methods for every finger of a scene that wears a pin array.

    Fingers that touch nothing are left out.

    Args:
        scene: the scene.
        library: library of presets.
        finer: accuracy of a finer mesh on which the commands are judged as well, such as 'fine'; '' for none.

    Raises:
        DermisError: no finger wears a pin array, none of them touches anything, or there is no finer mesh of one.
    """
    uses = [(f, use, library.device(use.preset)) for f, finger in enumerate(scene.fingers) for use in finger.devices]
    uses = [(f, use, spec) for f, use, spec in uses if spec.kind == "pin_array"]
    if not uses:
        raise DermisError("no finger wears a pin array", where=f"scene '{scene.name}'")
    wearers = sorted({f for f, _, _ in uses})
    for f in wearers if finer else ():
        if "mesh" in (scene.fingers[f].parameters.get("skin") or {}):
            raise DermisError(
                "a skin mesh of your own has no finer mesh to judge the commands on",
                where=_named(scene, f),
                remedy="Compare without a finer mesh, or with a skin described by its size",
            )
    own = _skins(scene, library, wearers, "")
    others = _skins(scene, library, wearers, finer) if finer else {}
    for f in wearers if finer else ():
        _finer(own[f].mesh.free.size, others[f].mesh.free.size, _named(scene, f))
    contacts = skin_contacts(scene, own)
    finer_contacts = skin_contacts(scene, others) if finer else contacts
    idle = [f for f in wearers if not len(contacts[f].contact) or not len(finer_contacts[f].contact)]
    if idle == wearers:
        raise DermisError(
            "nothing was touched, so there is nothing to compare", where=", ".join(_named(scene, f) for f in idle)
        )
    findings = [
        Finding("info", "idle-finger", "touches nothing, so it is left out of the comparison", _named(scene, f))
        for f in idle
    ]
    reports = {}
    for f, use, spec in uses:
        if f in idle:
            continue
        weighting, where = DEVICE["pin_nodes"].of(use.parameters), _named(scene, f)
        bounded = bool(DEVICE["pin_bounded"].of(use.parameters))
        reports[f"{scene.fingers[f].name}, {spec.name}"] = compare(
            contacts[f],
            spec,
            weighting=weighting,
            bounded=bounded,
            finer=finer_contacts[f] if finer else None,
            where=where,
        )
        findings += doubts(contacts[f], spec, weighting=weighting, where=where)
    return SceneReports(reports, tuple(findings))


def doubts(
    skin: SkinContact, spec: DeviceSpec, *, weighting: Weighting = "all", where: str = ""
) -> tuple[Finding, ...]:
    """Return a warning if the mesh is coarser than the pins, for a comparison of all methods."""
    ready = setup(skin.model, spec, weighting)
    return pin_resolution.doubts(ready.matcher, ready.distribution, METHODS, where or spec.name)


def _named(scene: TactileScene, f: int) -> str:
    return f"finger '{scene.fingers[f].name}'"


def _finer(nodes: int, others: int, where: str) -> None:
    """Raise an error if a mesh has no more free nodes than the one with which commands are computed."""
    if others <= nodes:
        raise DermisError(
            "the finer mesh is not finer than the one that the commands are made with",
            where=where,
            value=f"{others} free nodes",
            limit=f"> {nodes}",
            remedy="Choose a finer one to judge by, or a coarser skin for the finger",
        )


def _skins(scene: TactileScene, library: Library, wearers: Sequence[int], level: str) -> dict[int, SkinModel]:
    """Return the skins of all fingers whose touch must be solved, by finger.

    These are the wearers, and all other fingers with a simulated skin: they may hold an object together with a wearer.

    Args:
        scene: the scene.
        library: library of presets.
        wearers: indices of the fingers that wear a pin array.
        level: accuracy of their meshes; '' for their own.
    """
    skins = {}
    for f, finger in enumerate(scene.fingers):
        p = finger.parameters
        simulated = SKIN_CONTACT["skin_shown"].of(p) or any(
            library.device(d.preset).follows_skin for d in finger.devices
        )
        if f in wearers or simulated:
            own, preset = level if f in wearers else "", library.skin(DEFAULT_SKIN)
            skins[f] = finger_skin(p, preset, level=own, where=_named(scene, f))
    return skins


def error_on(ready: PinSetup, skin: SkinContact, matched: Matched) -> Array:
    """Return u_err of commands on another mesh than their own [m], shape (n,).

    The target is the touch that was solved on this mesh.

    Args:
        ready: matrices for this mesh.
        skin: touch on this mesh.
        matched: pin forces that were computed on another mesh.
    """
    matcher = ready.matcher
    result = np.zeros(len(skin.times))
    targets = skin.force.reshape(len(skin.contact), -1).astype(np.float64)
    forces = matched.forces[np.ix_(skin.contact, matcher.active)]
    result[skin.contact] = matcher.law_error(targets, forces, skin.amounts)
    return result


def table(reports: Sequence[MethodReport]) -> str:
    """Return reports as a table in plain text; displacements in um, force errors in mN."""
    finer = bool(reports) and np.isfinite(reports[0].finer_error)
    head = (
        f"{'':4} {'u_err um':>9} {'peak um':>9} {'of target':>9} {'f_err mN':>9} {'normal N':>9} {'shear/normal':>13}"
    )
    head += f" {'stress left':>11} {'at limit':>8}" + (f" {'finer um':>9} {'of target':>9}" if finer else "")
    lines = [head]
    for r in reports:
        line = f"{r.method:4} {1e6 * r.displacement_error:9.1f} {1e6 * r.displacement_peak:9.1f} "
        line += f"{100 * r.displacement_share:8.1f}% {1e3 * r.force_error:9.2f} {r.normal_force:9.3f} "
        line += f"{r.shear_ratio:13.3f} {100 * r.stress_share:10.1f}% {r.at_limit:8d}"
        lines.append(line + (f" {1e6 * r.finer_error:9.1f} {100 * r.finer_share:8.1f}%" if finer else ""))
    if reports:
        lines.append(f"target: normal {reports[0].target_normal:.3f} N, shear/normal {reports[0].target_ratio:.3f}")
    return "\n".join(lines)


def _report(
    method: Method, matched: Matched, ready: PinSetup, skin: SkinContact, size: float, fine: float, fine_share: float
) -> MethodReport:
    frames = skin.contact
    u, f = matched.displacement_error[frames], matched.force_error[frames]
    target = skin.force.astype(np.float64).sum(axis=1)
    shown = (matched.forces @ ready.pins.directions)[frames]
    ratio, normal = _ratio(shown)
    wanted, wanted_normal = _ratio(target)
    return MethodReport(
        method,
        _rms(u),
        float(u.max()),
        _rms(u) / size,
        _rms(f),
        ratio,
        wanted,
        normal,
        wanted_normal,
        int(matched.at_limit.max()),
        matched.worst,
        fine,
        fine_share,
        _rms(matched.stress_error[frames]),
    )


def _ratio(forces: Array) -> tuple[float, float]:
    normal = _rms(forces[:, 2])
    return _rms(np.hypot(forces[:, 0], forces[:, 1])) / max(normal, 1e-300), normal


def _target_size(ready: PinSetup, skin: SkinContact) -> float:
    """Return the RMS of the target's displacement in the norm of u_err [m]."""
    targets = skin.force.reshape(len(skin.contact), -1).astype(np.float64)
    nothing = np.zeros((len(targets), len(ready.matcher.active)))
    return _rms(ready.matcher.law_error(targets, nothing, skin.amounts))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0
