"""Fingertip, touch and device without a scene, for scripts and notebooks.

Frame: origin at the pad's centre, +Y towards the tip, +Z towards the nail. Everything in SI.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .cache import Cache
from .contact.single_touch import SingleTouch
from .contact.solver.bodies import ContactBody
from .devices.spec import DeviceSpec
from .errors import DermisError, Finding
from .parameters.material import FRICTION
from .parameters.skin import CONTACT, DEFAULT_SKIN, TISSUE
from .presets import Library
from .skin.blas import one_thread
from .skin.finger_skin import asked_for
from .skin.model import SkinModel, skin_from_parameters
from .skin.stimulus import Stimulus, von_mises
from .surface.gap import Surface
from .track.command_track import CommandTrack

DEEPEST = 5e-3  # [m] largest depth of a press; the results of linear skin are meaningless beyond it
FAR = 0.1  # [m] largest position and slide of a surface along X or Y, in the finger's axes
METRES = "Lengths are in metres: a millimetre is 1e-3"


@dataclass(frozen=True, eq=False)
class Touch(Stimulus):
    """State of a skin into which a surface is pressed.

    It is a `Stimulus` with data of the press.

    Attributes:
        depth: movement of the surface into the pad, from first contact with the undeformed skin [m].
        place: final position of the surface's origin in the finger's axes [m], shape (3,).
        residual: residual of Coulomb's law at the final position, relative to the forces, see `Solution.residual`.
        iterations: number of iterations of the contact solver at the final position.
        findings: warnings about the surface and its contact, such as a depth at which the skin is not valid, or a
            contact that did not converge.
    """

    depth: float = 0.0
    place: Array | None = None
    residual: float = 0.0
    iterations: int = 0
    findings: tuple[Finding, ...] = ()

    @cached_property
    def von_mises(self) -> Array:
        """Von Mises stress of each element [Pa], shape (e,)."""
        return von_mises(self.stress)

    @cached_property
    def normal_force(self) -> float:
        """Sum of the normal forces on the pad nodes, into the skin [N]."""
        return float(self.summary()["normal_force"])

    def __repr__(self) -> str:
        force = ", ".join(f"{f:.3g}" for f in self.resultant)
        return f"Touch({1e3 * self.depth:g} mm deep, force ({force}) N, residual {self.residual:.1g})"


@dataclass(frozen=True, eq=False)
class Match:
    """Commands of a device for a touch, with their error.

    Attributes:
        device: specification of the device.
        method: the matching method.
        values: values of all channels of the device, in each channel's unit, shape (channels,). The channels of a
            thimble include its pose.
        error: error of the quantity that the method compares: root mean square displacement [m] for DM methods, root
            mean square force [N] for FM methods, relative mismatch [1] for a thimble.
        optimality: relative KKT residual of the solution; 0 for the methods that clamp.
        rendered: state of the skin under the device.
    """

    device: DeviceSpec
    method: str
    values: Array
    error: float
    optimality: float
    rendered: Stimulus

    @property
    def commands(self) -> dict[str, float]:
        """Commands of the actuators by channel name, in each channel's unit."""
        named = zip(self.device.channels, self.values.tolist(), strict=True)
        return {channel.name: value for channel, value in named if channel.actuator}

    def track(self, duration: float = 1.0) -> CommandTrack:
        """Return a track of these constant commands, at the device's rate.

        `write_csv` writes the track to a file for playback. The commands begin at once. To move there from the device's
        rest within its speed limits, apply `within_limits(start_at_rest=True)` to the track.

        Args:
            duration: duration of the track [s].

        Raises:
            DermisError: the duration is not above zero, or needs more samples than a track can hold.
        """
        values, meta = np.tile(self.values, (2, 1)), {"method": self.method}
        return CommandTrack(self.device, np.array([0.0, duration]), values, meta).resampled(self.device.rate)

    def __repr__(self) -> str:
        return f"Match({self.device.key}, {self.method}, error {self.error:.3g}, optimality {self.optimality:.1g})"


def fingertip(
    preset: str = DEFAULT_SKIN,
    *,
    level: str = "standard",
    young: float | None = None,
    poisson: float | None = None,
    alpha: float | None = None,
    tissue: str = "linear",
    presets: Library | None = None,
    cache: Cache | None = None,
    **lengths: float,
) -> SkinModel:
    """Return the skin of a fingertip.

    Args:
        preset: key of a preset of `presets/skins`.
        level: resolution of the mesh: 'draft', 'standard', 'fine' or 'reference'.
        young: Young's modulus [Pa]; None takes the preset's.
        poisson: Poisson's ratio; None takes the preset's.
        alpha: stiffness of a person's skin relative to `young`; None takes the preset's.
        tissue: 'linear', or 'neo_hookean' for tissue that stiffens under load.
        presets: library of presets; None for the built-in ones.
        cache: folder in which computed skins are stored. Contact on points also needs a table of the smooth skin. For
            lengths or a Poisson's ratio that no preset has, the table must be in this folder; without it, contact is
            solved at the mesh's nodes.
        lengths: lengths that replace those of the preset [m], by the preset's names: width, thickness, length,
            bone_bed ...

    >>> import dermis
    >>> dermis.fingertip(level="draft")
    SkinModel(fingertip, 468 nodes, 78 on the pad, E 100 kPa)
    >>> dermis.fingertip("thumb_large", level="draft", alpha=0.8, width=19e-3)
    SkinModel(fingertip, 468 nodes, 78 on the pad, E 80 kPa)

    Raises:
        DermisError: the preset, level, tissue or length is unknown, or the shape cannot be meshed.
    """
    parameters = (presets or Library()).skin(preset)
    unknown = sorted(set(lengths) - set(parameters) | set(lengths) & set(TISSUE))
    if unknown:
        known = ", ".join(sorted(set(parameters) - set(TISSUE)))
        raise DermisError("a fingertip has no such length", where=preset, value=", ".join(unknown), limit=known)
    given = {"young": young, "poisson": poisson, "alpha": alpha, **lengths}
    parameters |= {name: value for name, value in given.items() if value is not None}
    where = f"fingertip '{preset}'"
    return asked_for(skin_from_parameters(parameters, level=level, cache=cache, where=where), tissue, where)


def press(
    skin: SkinModel,
    surface: Surface,
    depth: float = 1e-3,
    *,
    friction: float = FRICTION,
    slide: Sequence[float] = (0.0, 0.0),
    at: Sequence[float] = (0.0, 0.0),
    turn: NDArray[np.floating] | None = None,
    contact: str = CONTACT,
) -> Touch:
    """Press a surface into the pad, slide it, and return the touch.

    The surface rises along +Z from first contact to its depth, then slides. It moves in steps of at most 0.1 mm,
    because friction depends on the path. A bake takes the same steps if its samples are 0.1 mm apart.

    Args:
        skin: model of the skin.
        surface: the surface, in the finger's axes. Its position along Z does not matter.
        depth: rise beyond first contact [m].
        friction: Coulomb's coefficient of friction.
        slide: movement along X and Y after the rise [m], shape (2,).
        at: X and Y of the surface's origin at first contact [m], shape (2,).
        turn: rotation of the surface, shape (3, 3); None for no rotation.
        contact: 'nodes' to solve contact at the nodes of the skin's mesh, or 'points' to solve it at points of the
            smooth skin, which adapt to the size of the touch.

    The tangential force of a plate that slid is no more than friction allows:

    >>> import dermis
    >>> plate = dermis.Surface.block(0.1, 0.1)
    >>> touch = dermis.press(dermis.fingertip(level="draft"), plate, 1e-3, friction=0.4, slide=(4e-3, 0.0))
    >>> across, _, up = touch.resultant  # [N] on the skin, which is drawn along with the plate
    >>> bool(0.35 < across / up < 0.41)
    True
    >>> touch.stress.shape, touch.pressure.shape  # of the elements, and of the pad's nodes [Pa]
    ((1560, 6), (78,))

    Raises:
        DermisError: a number is out of range, `turn` is no rotation, `contact` is unknown, or the surface does not meet
            the pad.
    """
    _check_kind("skin", skin, SkinModel)
    _check_kind("surface", surface, Surface)
    depth = float(_numbers("depth", depth, (), 0.0, DEEPEST, f"0 to {DEEPEST:g} m", METRES))
    friction = float(_numbers("friction", friction, (), 0.0, np.finfo(float).max, ">= 0"))
    along = _numbers("slide", slide, (2,), -FAR, FAR, f"X and Y, up to {FAR:g} m", METRES)
    origin = _numbers("at", at, (2,), -FAR, FAR, f"X and Y, up to {FAR:g} m", METRES)
    rotation = np.eye(3) if turn is None else _numbers("turn", turn, (3, 3), -1.0, 1.0, "a rotation, shape (3, 3)")
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9) or np.linalg.det(rotation) < 0.0:
        raise DermisError("not a rotation", where="turn", value=rotation.tolist(), limit="orthonormal, right-handed")
    body = ContactBody(surface, rotation, np.array([*origin, 0.0]), friction=friction)
    doubtful = [f for f in surface.findings("surface") if f.severity != "info"]
    with one_thread():
        touch = SingleTouch(skin, body, "press", contact)
        touch.move((0.0, 0.0, depth))
        if depth > 0.0 and not touch.step.solution.force.any():
            doubtful.append(_unfelt(touch, depth))
        step = touch.move((*along, 0.0))
    found = skin, step.nodal, touch.points, step.amounts
    solution, told = step.solution, (*doubtful, *touch.findings)
    return Touch(*found, depth, touch.place, solution.residual, solution.iterations, told)


def _unfelt(touch: SingleTouch, depth: float) -> Finding:
    """Return the finding that a surface in the skin exerts no force on it."""
    where = "the points" if touch.pad is not None else "the nodes"
    what = f"the surface is not touched: it lies between {where} that contact is solved at, or went through the skin"
    remedy = "Solve its contact on points of the smooth skin, or press less deep"
    return Finding("warning", "smaller-than-mesh", what, touch.name, f"{1e3 * depth:g} mm deep", remedy=remedy)


def match(
    touch: Stimulus,
    device: str | DeviceSpec = "pin_array_128",
    method: str | None = None,
    *,
    presets: Library | None = None,
) -> Match:
    """Return the commands with which a device reproduces a touch.

    The commands are within the limits of the device.

    Args:
        touch: state of the skin to reproduce.
        device: preset key or specification of a pin array or a thimble.
        method: matching method. Pin arrays: 'DM0', 'DM1', 'DM2', 'FM0', 'FM1' or 'FM2'; None for 'DM2'. Thimbles:
            'stress', 'force' or 'geometry'; None for 'stress'.
        presets: library of presets; None for the built-in ones.

    >>> import dermis
    >>> touch = dermis.press(dermis.fingertip(level="draft"), dermis.Surface.sphere(5e-3), 1e-3)
    >>> pins = dermis.match(touch, "pin_array_128")
    >>> len(pins.commands), pins.optimality < 1e-9
    (128, True)
    >>> worse = dermis.match(touch, "pin_array_128", method="DM1")  # solved without limits, then clamped
    >>> worse.error > pins.error
    True

    A track that holds the commands for a second; `write_csv` writes it to a file:

    >>> pins.track(1.0)
    CommandTrack(pin_array_128, 128 channels, 241 samples, 1 s at 240 Hz)

    Raises:
        DermisError: the device or the method is unknown, or the device is neither a pin array nor a thimble. Commands
            of other devices depend on time or on tables; `run` renders them from a scene.
    """
    _check_kind("touch", touch, Stimulus)
    spec = (presets or Library()).device(device) if isinstance(device, str) else device
    _check_kind("device", spec, DeviceSpec)
    matchers: dict[str, Callable[[Stimulus, DeviceSpec, str | None], Match]] = {
        "pin_array": _match_pins,
        "thimble": _match_thimble,
    }
    if spec.kind not in matchers:
        raise DermisError(
            "a single touch is matched on pin arrays and thimbles only",
            where=spec.key,
            value=spec.kind,
            limit=", ".join(matchers),
            remedy="Render a scene with this device",
        )
    with one_thread():
        return matchers[spec.kind](touch, spec, method)


def _match_pins(touch: Stimulus, spec: DeviceSpec, method: str | None) -> Match:
    from .matching.deformation import METHODS
    from .matching.pins import make_solver, rendered_force, setup

    chosen = next((m for m in METHODS if m == (method or "DM2")), None)
    if chosen is None:
        raise DermisError("unknown matching method", where=spec.key, value=method, limit=", ".join(METHODS))
    ready = setup(touch.skin, spec)
    found = make_solver(ready, spec, chosen, None).solve(touch.force, touch.amounts)
    error = found.displacement_error if chosen.startswith("DM") else found.force_error
    pressed = rendered_force(ready, found.forces)
    rendered = Stimulus(touch.skin, pressed) if found.look is None else found.look.felt(touch.skin, pressed)
    return Match(spec, chosen, found.forces, error, found.optimality, rendered)


def _match_thimble(touch: Stimulus, spec: DeviceSpec, method: str | None) -> Match:
    from .matching.thimble import match_touch
    from .matching.thimble_use import prepare

    skin = touch.skin if touch.points is not None else touch.skin.on_nodes  # contact is solved as for the touch
    use = prepare(spec, skin, {"thimble_method": method or "stress"}, f"match, {spec.key}")
    if use.findings:
        raise DermisError(
            use.findings[0].what.removeprefix("the direct method was used: "),
            where=spec.key,
            value=method,
            limit="stress, force, geometry",
        )
    found = match_touch(use, touch.force[None], amounts=None if touch.amounts is None else touch.amounts[None])
    return Match(
        spec,
        use.method,
        found.commands(spec)[0],
        float(found.mismatch[0]),
        float(found.kkt[0]),
        Stimulus(
            touch.skin, found.force[0].astype(np.float64), given=None if found.amounts is None else found.amounts[0]
        ),
    )


def _check_kind(name: str, value: object, kind: type) -> None:
    if not isinstance(value, kind):
        raise DermisError(f"expected {kind.__name__}, got {type(value).__name__}", where=name)


def _numbers(
    name: str, value: object, shape: tuple[int, ...], low: float, high: float, limit: str, remedy: str = ""
) -> Array:
    """Return a value as real numbers of the given shape and range.

    Args:
        name: name of the value, for the message.
        value: the value.
        shape: required shape.
        low, high: smallest and largest number allowed.
        limit: the allowed values, for the message.
        remedy: a way to solve the problem, for the message.

    Raises:
        DermisError: the value has another shape, numbers out of range, or booleans.
    """
    numbers = np.asarray(value)
    if numbers.shape != shape or numbers.dtype.kind not in "iuf" or not ((numbers >= low) & (numbers <= high)).all():
        what = "expected real numbers within the range" if shape else "expected a real number within the range"
        raise DermisError(what, where=name, value=numbers.tolist(), limit=limit, remedy=remedy)
    return numbers.astype(np.float64)
