"""What a scene may never need is read when it is first used, and then it is all there."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytestmark = pytest.mark.shared_cases("names of modules")

ROOT = Path(__file__).resolve().parents[2]
ADDON = ROOT / "blender_addon"
PACKAGES = sorted(p.parent.name for p in ADDON.glob("*/__init__.py") if "on_demand.modules_of" in p.read_text())
MODULES = [(package, p.stem) for package in PACKAGES for p in sorted((ADDON / package).glob("[a-z]*.py"))]


def after_registering(code: str) -> str:
    """Return what code prints in a Blender of its own that has just enabled the add-on."""
    script = f"import os, sys\nimport bpy\nimport blender_addon\nblender_addon.register()\n{code}\nos._exit(0)\n"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_attaching_demos_films_and_sampling_are_not_read_by_registering() -> None:
    names = "hands.rig film.skin_mesh demos.demo_skin sampling.recorder streaming.session preview.thimble_preview"
    told = after_registering(
        f"read = [n for n in {names!r}.split() if 'blender_addon.' + n in sys.modules]\n"
        "from blender_addon.hands import rig\n"
        "before = 'blender_addon.hands.rig' in sys.modules\n"
        "print('READ', *read, before, callable(rig.read), 'blender_addon.hands.rig' in sys.modules, flush=True)"
    )
    assert "READ False True True" in told


def test_what_is_not_read_yet_is_kept_from_who_asks_all_modules_for_their_files() -> None:
    """Blender does, for its complaints about extensions."""
    told = after_registering(
        "before = len(sys.modules)\nfor module in sys.modules.values():\n    getattr(module, '__file__', None)\n"
        "print('MORE', len(sys.modules) - before, flush=True)"
    )
    assert "MORE 0" in told


@pytest.mark.parametrize(("package", "name"), MODULES, ids=[".".join(pair) for pair in MODULES])
def test_each_module_can_be_read(package: str, name: str) -> None:
    home: Any = import_module(f"blender_addon.{package}")
    stands_for_it, module = home.__getattr__(name), import_module(f"{home.__name__}.{name}")
    assert type(module) is ModuleType and module is getattr(home, name)
    assert stands_for_it.__file__ == module.__file__


def test_who_has_asked_once_has_the_module_itself() -> None:
    hands: Any = import_module("blender_addon.hands")
    stands_for_it, module = hands.__getattr__("rig"), import_module("blender_addon.hands.rig")
    user = {"rig": stands_for_it, "other": stands_for_it, "known": []}
    exec("known.append(rig.read)\nknown.append(other.read)", user)
    assert user["known"] == [vars(module)["read"]] * 2
    assert user["rig"] is module and user["other"] is stands_for_it  # by another name it works as well


def test_what_is_replaced_is_replaced_in_the_module() -> None:
    hands: Any = import_module("blender_addon.hands")
    rig, module = hands.__getattr__("rig"), import_module("blender_addon.hands.rig")
    rig.made_up = 1
    assert vars(module)["made_up"] == vars(rig)["made_up"] == rig.made_up == 1
    del rig.made_up
    assert not hasattr(rig, "made_up") and "made_up" not in vars(module)


def test_no_name_of_a_module_hides_behind_what_stands_for_it() -> None:
    """`loading._read` is a function of that module."""
    addon: Any = import_module("blender_addon")
    for name in ("loading", "on_demand", "reporting"):
        stands_for_it, module = addon.__getattr__(name), import_module(f"blender_addon.{name}")
        own = [n for n in vars(module) if not n.startswith("__")]
        assert own and all(getattr(stands_for_it, n) is getattr(module, n) for n in own)
        for n in vars(type(stands_for_it)):
            assert n.startswith(("__", "_OnDemand__")), n


def test_a_name_that_is_no_module_is_refused_as_ever() -> None:
    hands: Any = import_module("blender_addon.hands")
    with pytest.raises(AttributeError, match=r"'blender_addon.hands' has no attribute 'rgi'"):
        _ = hands.rgi
    with pytest.raises(ImportError, match="rgi"):
        from blender_addon.hands import rgi  # type: ignore[attr-defined]  # noqa: F401
    assert not hasattr(hands, "rig.read")  # a name with a dot is none


def test_a_file_that_cannot_be_read_says_so_whoever_asks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`hasattr` takes an AttributeError for an answer: a renamed part of Blender would go unnoticed."""
    broken = tmp_path / "broken_rooms"
    broken.mkdir()
    on_demand = "from blender_addon import on_demand\non_demand.modules_of(globals())\n"
    (broken / "__init__.py").write_text(on_demand, encoding="utf-8")
    (broken / "one.py").write_text("import math\nmath.no_such_thing\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    room = import_module("broken_rooms").__getattr__("one")
    for ask in (lambda: hasattr(room, "x"), lambda: getattr(room, "x", None), lambda: room.x):
        with pytest.raises(ImportError, match=r"broken_rooms.one cannot be read: .*no_such_thing"):
            ask()
    assert "broken_rooms.one" not in sys.modules and "not read yet" in repr(room)


def test_what_has_not_been_read_has_nothing_to_forget() -> None:
    """Neither opening a file nor disabling the add-on reads modules to tell them so."""
    told = after_registering(
        "from blender_addon import on_demand\nfrom blender_addon.hands import rig\n"
        "def new(): return {n for n in sys.modules if n.startswith('blender_addon.')} - before\n"
        "before = set()\nbefore = new()\n"
        "known = list(on_demand.read(rig, on_demand)) == [on_demand]\n"
        "bpy.ops.wm.read_homefile(use_factory_startup=True)\nblender_addon.unregister()\n"
        "print('NEW', *sorted(n.partition('.')[2] for n in new()))\n"
        "print('KNOWN', known, len(list(on_demand.read(rig))), rig.read and len(list(on_demand.read(rig))), flush=True)"
    )
    (new,) = (line.split()[1:] for line in told.splitlines() if line.startswith("NEW"))
    assert set(new) <= {"changes", "scene_time", "action_content", "identity", "loading"}, "of every file"
    assert "KNOWN True 0 1" in told
