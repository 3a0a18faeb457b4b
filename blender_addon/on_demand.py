"""Modules that load when something of them is first used: enabling the add-on pays for what every scene needs.

Where the `__init__` of a package says `on_demand.modules_of(globals())`, `from ..hands import rig` reads no file yet:
`rig.read(...)` does. `from ..hands.rig import read` reads it at once, as ever. A mistake in such a file therefore
shows at its first use; a test loads them all.

What stands for a module until then is kept out of `sys.modules` (as importlib's own LazyLoader does not): Blender asks
everything in there for its file, and would read them all in the middle of that.
"""

import importlib.util
from types import ModuleType
from typing import Any


def modules_of(package: dict[str, Any]) -> None:
    """Let the modules of a package load when something of them is first used.

    Args:
        package: its globals. They get a `__getattr__` (PEP 562) here, where checkers of types still see what is there.
    """

    def on_demand(name: str) -> "_OnDemand":
        module = f"{package['__name__']}.{name}"
        if name.startswith("__") or not name.isidentifier() or importlib.util.find_spec(module) is None:
            raise AttributeError(f"module {package['__name__']!r} has no attribute {name!r}")
        return _OnDemand(module)

    package["__getattr__"] = on_demand


class _OnDemand:
    """A module that is read at its first use; what is set here is set there."""

    __slots__ = ("_name", "_read")

    def __init__(self, name: str) -> None:
        object.__setattr__(self, "_name", name)
        object.__setattr__(self, "_read", None)

    def __getattr__(self, name: str) -> Any:
        if name in _OnDemand.__slots__:  # of a copy that nobody has filled
            raise AttributeError(name)
        return getattr(self._read or self._module(), name)

    def __setattr__(self, name: str, value: object) -> None:
        setattr(self._module(), name, value)

    def __delattr__(self, name: str) -> None:
        delattr(self._module(), name)

    def __repr__(self) -> str:
        return f"<module {self._name!r}, {'not read yet' if self._read is None else 'read on demand'}>"

    @property
    def __dict__(self) -> dict[str, Any]:  # type: ignore[override]
        return vars(self._module())

    def _module(self) -> ModuleType:
        try:
            module = importlib.import_module(self._name)
        except AttributeError as error:  # a mistake in the file, which `hasattr` must not hide
            raise ImportError(f"{self._name} cannot be read: {error}", name=self._name) from error
        object.__setattr__(self, "_read", module)
        return module
