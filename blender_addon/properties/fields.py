"""How a property of ours is declared, and what it is to the engine."""

from typing import Any, NamedTuple

from bpy.props import BoolProperty, EnumProperty, FloatProperty

from .. import changes

FACTORS = {"_mm_s": 1e-3, "_mpa_m": 1e6, "_mm": 1e-3}
OVERRIDE = {"LIBRARY_OVERRIDABLE"}


class Attribute(NamedTuple):
    """How one property becomes an engine parameter: value_in_SI = property * factor."""

    attribute: str
    parameter: str
    factor: float


def touched(_self: Any, _context: Any) -> None:
    """Note that what is shown may be out of date."""
    changes.mark_dirty()


def number(name: str, text: str, default: float, low: float, high: float, **more: Any) -> Any:
    """Declare an animatable number; values are refused, not clamped, only outside what is physically possible."""
    more.setdefault("soft_min", low)
    return FloatProperty(
        name=name, description=text, default=default, min=low, max=high, update=touched, override=OVERRIDE, **more
    )


def millimetres(name: str, text: str, default: float, low: float, high: float, **more: Any) -> Any:
    """Declare an animatable length of the size of a finger [mm]."""
    return number(name, text, default, low, high, unit="CAMERA", precision=3, **more)


def switch(name: str, text: str, default: bool, **more: Any) -> Any:
    """Declare a switch that can be animated, unless `options` say otherwise."""
    return BoolProperty(name=name, description=text, default=default, update=touched, override=OVERRIDE, **more)


def choice(name: str, text: str, items: tuple[tuple[Any, ...], ...], default: str, **more: Any) -> Any:
    """Declare a choice; methods and kinds stay constant over a scene, so they cannot be keyframed."""
    return EnumProperty(
        name=name,
        description=text,
        items=items,
        default=default,
        options=set(),
        update=touched,
        override=OVERRIDE,
        **more,
    )


def attributes_of(group: Any, *leave_out: str) -> tuple[Attribute, ...]:
    """Return what a group's own properties are to the engine."""
    found = []
    for name in group.__annotations__:
        if name in leave_out:
            continue
        suffix = next((s for s in FACTORS if name.endswith(s)), "")
        found.append(Attribute(name, name.removesuffix(suffix), FACTORS.get(suffix, 1.0)))
    return tuple(found)
