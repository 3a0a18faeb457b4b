"""Install, enable, disable, uninstall: what Blender sees of the extension at each step."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

FORBIDDEN = ("scipy", "onnxruntime", "serial", "PIL", "threadpoolctl")


def ours(package: str) -> Counter[str]:
    """Count what an add-on leaves in Blender: application handlers, menu entries, operators, property groups."""
    import bpy

    counts: Counter[str] = Counter()
    for name in dir(bpy.app.handlers):
        handlers = getattr(bpy.app.handlers, name)
        if isinstance(handlers, list):
            for function in handlers:
                if function.__module__.startswith(package):
                    counts[f"handler {name} {function.__module__}.{function.__qualname__}"] += 1
    for name in ("VIEW3D_MT_add", "TOPBAR_MT_file_export", "VIEW3D_MT_object"):
        draw = getattr(getattr(bpy.types, name), "draw", None)
        for function in getattr(draw, "_draw_funcs", ()):
            if getattr(function, "__module__", "").startswith(package):
                counts[f"menu {name}"] += 1
    for owner in ("Scene", "Object", "WindowManager"):
        if "dermis" in getattr(bpy.types, owner).bl_rna.properties:
            counts[f"property {owner}.dermis"] += 1
    for name in dir(bpy.types):
        if getattr(getattr(bpy.types, name, None), "__module__", "").startswith(package):
            counts[f"class {name}"] += 1
    counts["operators"] = len(dir(bpy.ops.dermis))
    return +counts


def test_enable_and_disable_three_times_leaves_one_then_nothing(dermis: Any) -> None:
    import addon_utils

    first = ours(dermis.PACKAGE)
    handlers = {name: count for name, count in first.items() if name.startswith("handler")}
    assert handlers and set(handlers.values()) == {1}
    assert first["operators"] > 0 and any(name.startswith("property") for name in first)
    for _ in range(3):
        addon_utils.disable(dermis.PACKAGE)
        assert ours(dermis.PACKAGE) == Counter()
        assert addon_utils.enable(dermis.PACKAGE) is not None
        assert ours(dermis.PACKAGE) == first


def test_handlers_survive_opening_a_file(dermis: Any) -> None:
    import bpy

    before = ours(dermis.PACKAGE)
    bpy.ops.wm.read_homefile(use_factory_startup=False)
    assert ours(dermis.PACKAGE) == before


def test_blender_has_no_complaint_about_policy(dermis: Any) -> None:
    assert dermis.policy_warnings() == {}


def test_policy_check_can_complain(dermis: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The check above is worth something: a folder of the extension on the search path is found."""
    import sys

    monkeypatch.syspath_prepend(str(dermis.package_folder()))
    try:
        assert dermis.PACKAGE in dermis.policy_warnings()
    finally:
        monkeypatch.undo()
        sys.path_importer_cache.clear()
    assert dermis.policy_warnings() == {}


def test_the_engine_is_the_one_in_the_zip(dermis: Any) -> None:
    import sys

    core = dermis.part("_core").core
    assert core.__name__ == f"{dermis.PACKAGE}.core"
    assert "core" not in sys.modules
    assert dermis.package_folder().resolve() in type(dermis.package_folder())(core.__file__).resolve().parents


def test_version_is_the_manifests(dermis: Any) -> None:
    import tomllib

    manifest = tomllib.loads((dermis.package_folder() / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert dermis.part("core.version").version() == manifest["version"]


def test_registering_loads_nothing_heavy(fresh_blender: Any, zip_path: Any) -> None:
    fresh_blender(f"import walkthrough\nwalkthrough.install({str(zip_path)!r}, enable=False)")
    loaded = fresh_blender(
        "import bpy, addon_utils, walkthrough\n"
        "before = set(sys.modules)\n"
        "assert addon_utils.enable(walkthrough.PACKAGE) is not None\n"
        "answer = sorted({name.partition('.')[0] for name in set(sys.modules) - before})\n"
    )
    assert "bl_ext" in loaded
    assert not set(loaded) & set(FORBIDDEN)


def test_the_wheels_of_the_zip_are_the_ones_that_load(fresh_blender: Any, zip_path: Any) -> None:
    found = fresh_blender(
        f"import walkthrough\nwalkthrough.install({str(zip_path)!r})\n"
        "import scipy.linalg, onnxruntime, serial, PIL, threadpoolctl, numpy\n"
        "modules = (scipy, onnxruntime, serial, PIL, threadpoolctl, numpy)\n"
        "answer = {m.__name__: [m.__file__, m.__version__] for m in modules}\n"
        "answer['solved'] = scipy.linalg.solve([[2.0, 1.0], [1.0, 3.0]], [3.0, 5.0]).tolist()\n"
    )
    brought = {"scipy": "1.17.1", "onnxruntime": "1.31.1", "serial": "3.5", "PIL": "13.0.0", "threadpoolctl": "3.8.0"}
    for name, version in brought.items():
        assert "extensions" in found[name][0] and found[name][1] == version
    assert "extensions" not in found["numpy"][0]
    assert found["solved"] == pytest.approx([0.8, 1.4], abs=1e-15)


def test_the_kernels_of_the_zip_are_loaded_from_a_copy(fresh_blender: Any, zip_path: Any) -> None:
    """Installed as Blender installs wheels, copied when a skin first needs them; children load the copy, too."""
    found = fresh_blender(
        f"import walkthrough\nwalkthrough.install({str(zip_path)!r})\n"
        "library = walkthrough.part('core.kernels.library')\n"
        "surface = walkthrough.part('core.surface.gap').Surface.block()\n"
        "early = library._loaded.cache_info().currsize\n"
        "import numpy, bpy\n"
        "gap = surface.query(numpy.array([[0.0, 0.0, 0.003]] * 9)).gap.tolist()\n"
        "own = library.kernels().path\n"
        "brought = library.find(library.building.this_platform(), library._folders())\n"
        "folder = bpy.utils.extension_path_user(walkthrough.PACKAGE, path='kernels')\n"
        "child = walkthrough.part('core.work.child').environment()[library.COPIES]\n"
        "same = own.read_bytes() == brought.read_bytes()\n"
        "names = [own.name, library.building.digest()]\n"
        "answer = [early, gap, str(own.parent), folder, child, str(brought), *names, same]\n"
    )
    early, gap, path, folder, child, brought, name, digest, same = found
    assert early == 0 and gap == [0.003] * 9
    assert path == folder == child and digest in name and same
    assert "extensions" in brought and "dermis_kernels" in brought


def test_uninstalling_leaves_nothing(fresh_blender: Any, zip_path: Any) -> None:
    left = fresh_blender(
        f"import walkthrough\nwalkthrough.install({str(zip_path)!r})\n"
        "folder = walkthrough.package_folder()\nassert (folder / 'blender_manifest.toml').is_file()\n"
        "walkthrough.uninstall()\n"
        "import bpy\n"
        "answer = [folder.exists(), walkthrough.PACKAGE in bpy.context.preferences.addons, len(dir(bpy.ops.dermis))]\n"
    )
    assert left == [False, False, 0]
