"""Modules that load at their first use.

Enabling the add-on thus loads only the modules that every scene needs. If the `__init__` of a package calls
`on_demand.modules_of(globals())`, `from ..hands import rig` reads no file yet: `rig.read(...)` does. `from ..hands.rig
import read` reads it at once, as usual. A mistake in such a file therefore shows at its first use; a test loads them
all.

Before its first use, the stand-in for a module is not in `sys.modules`, unlike that of importlib's LazyLoader. Blender
queries the file of everything in there, and would thereby load all modules.
"""

from collections.abc import Iterator
from importlib import import_module
from os import listdir
from sys import _getframe
from types import ModuleType
from typing import Any


def modules_of(package: dict[str, Any]) -> None:
    """Let the modules of a package load at their first use.

    Its folders load as usual.
    Args:
        package: its globals, which get a `__getattr__` (PEP 562). It is set here, not in the package's file, so that
            type checkers still see the package's names.
    """
    names = {file[:-3] for folder in package["__path__"] for file in listdir(folder) if file.endswith(".py")}

    def on_demand(name: str) -> "_OnDemand":
        if name not in names or name.startswith("__"):
            raise AttributeError(f"module {package['__name__']!r} has no attribute {name!r}")
        made = _OnDemand(package, name)
        package.setdefault(name, made)  # the import puts the module in its place
        return made

    package["__getattr__"] = on_demand


def read(*modules: Any) -> Iterator[Any]:
    """Return the modules that have been loaded; the others have nothing to forget."""
    return (module for module in modules if not isinstance(module, _OnDemand) or _imported(module))


def _imported(module: "_OnDemand") -> bool:
    place, name = module._OnDemand__package, module._OnDemand__name
    return not isinstance(place.get(name, module), _OnDemand)


class _OnDemand:
    """Stand-in for a module that is loaded at its first use.

    An attribute that is set here is set in the module. The stand-in's own names are mangled, so that they hide no name
    of the module.
    """

    __slots__ = ("__name", "__package", "__read")

    def __init__(self, package: dict[str, Any], name: str) -> None:
        object.__setattr__(self, "_OnDemand__package", package)
        object.__setattr__(self, "_OnDemand__name", name)
        object.__setattr__(self, "_OnDemand__read", None)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_OnDemand__"):  # of a copy that nobody has filled
            raise AttributeError(name)
        module = self.__read or self.__module()
        user = _getframe(1).f_globals  # the caller gets the module itself, because the detour costs time in each frame
        if user.get(self.__name) is self:
            user[self.__name] = module
        return getattr(module, name)

    def __setattr__(self, name: str, value: object) -> None:
        setattr(self.__module(), name, value)

    def __delattr__(self, name: str) -> None:
        delattr(self.__module(), name)

    def __repr__(self) -> str:
        return f"<module {self.__full()!r}, {'not read yet' if self.__read is None else 'read on demand'}>"

    @property
    def __dict__(self) -> dict[str, Any]:  # type: ignore[override]
        return vars(self.__module())

    def __full(self) -> str:
        return f"{self.__package['__name__']}.{self.__name}"

    def __module(self) -> ModuleType:
        try:
            module = import_module(self.__full())
        except AttributeError as error:  # a mistake in the file, which `hasattr` must not hide
            raise ImportError(f"{self.__full()} cannot be read: {error}", name=self.__full()) from error
        object.__setattr__(self, "_OnDemand__read", module)
        return module
