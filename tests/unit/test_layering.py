"""Who may import whom: the architecture's table, held against the source text."""

from __future__ import annotations

import ast
import functools
from pathlib import Path

import pytest

from core.devices.kinds import KINDS

pytestmark = pytest.mark.one_line("3.11", "the text of the sources is read")

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "core"
ADDON = ROOT / "blender_addon"

GROUND = set(
    "arrays components errors units version foreign files npz column_names number_rows cache interpolate recent "
    "following steps parameters shipped memory clock kernels".split()
)
# Files of devices/ that need no more than a device's description: presets are judged by them.
MECHANISMS = {kind.mechanism.partition(".")[0] for kind in KINDS.values()} | set(
    "preset_check mechanism linkage inverse_kinematics forward_kinematics servo_limits poses coupling "
    "retraction calibration response response_readings frequency_response gain_curve measured_day".split()
)
DEVICE = GROUND | {"devices.spec", "devices.mechanisms"}
SCENE = GROUND | {"scene"}
TRACK = DEVICE | {"presets", "track"}
CONTACT = SCENE | {"motion", "skin", "surface", "contact.solver"}
MATCHING = CONTACT | TRACK | {"contact", "devices", "effects", "images", "surrogate", "matching"}
LIVE = TRACK | {"work", "stream.protocols", "stream.protocols.bus", "stream.links", "stream.virtual", "stream.log"}
# folder or loose file: which others it may import. Within itself everybody may; no file imports in a circle.
MAY_IMPORT: dict[str, set[str]] = {
    # the ground
    "arrays": set(),
    "components": {"arrays"},
    "errors": set(),
    "version": set(),
    "recent": set(),
    "shipped": set(),
    "following": {"arrays"},
    "memory": {"arrays"},
    "steps": set(),
    "clock": set(),
    "units": {"errors"},
    "parameters": {"errors", "units"},
    "foreign": {"errors"},
    "files": {"errors", "foreign"},
    "npz": {"errors", "foreign", "files"},
    "kernels": {"errors", "files"},
    "column_names": {"errors"},
    "number_rows": {"arrays", "column_names", "errors", "files"},
    "interpolate": {"arrays", "errors", "units"},
    "cache": {"errors", "units", "version", "files"},
    "work": GROUND,
    "images": GROUND,
    "motion": GROUND,
    # what a device is
    "devices.spec": {"errors", "units", "parameters"},  # only its description: tracks carry it
    "devices.mechanisms": GROUND | {"devices.spec"},
    "presets": DEVICE,
    "own_presets": DEVICE | {"presets"},
    "track": TRACK,
    "plot": TRACK,
    # what is felt
    "scene": GROUND,
    "surface": SCENE,
    "skin": SCENE,
    "contact.solver": GROUND | {"motion", "surface", "skin"},
    "contact": CONTACT,
    # what a device does about it
    "devices": DEVICE | {"surface", "contact.solver", "skin"},
    "effects": SCENE | {"images", "motion"},
    "surrogate": DEVICE | {"skin", "devices"},
    "matching": MATCHING,
    "experiment": MATCHING,
    "design": MATCHING | {"plot", "work"},
    "pipeline": MATCHING | {"plot", "work"},
    # the whole way, for one touch and every device
    "comparison": MATCHING | {"plot", "pipeline", "work", "experiment"},
    "studies": MATCHING | {"plot", "pipeline"},
    "sweep": MATCHING | {"plot", "pipeline", "work", "design", "comparison"},
    # live to the hardware
    "stream.protocols": DEVICE,
    "stream.protocols.bus": DEVICE | {"stream.protocols"},
    "stream.links": DEVICE | {"stream.protocols"},
    "stream.virtual": DEVICE | {"stream.protocols", "stream.protocols.bus", "stream.links", "work"},
    "stream.log": DEVICE | {"stream.protocols", "stream.links", "work"},
    "stream": LIVE,
    "stream.sound": LIVE | {"stream"},
    "stream.daq": LIVE | {"stream"},
    "stream.acceptance": LIVE | {"stream"},
}
SEES_ALL = {"__init__", "__main__", "command_line"}

# The add-on's rooms in the order of the data. A file imports only from rooms above its own, and from its own;
# imports inside functions and for types count.
ROOMS = (
    # the ground: who knows nothing of scenes, or only how to ask one
    "on_demand", "_core", "compat", "registration", "scene_time", "action_content", "changes", "redraw", "loading",
    "quantities", "layouts", "polls", "animation_paths", "fingertip_mesh", "identity", "preferences", "reporting",
    "choices", "marks",
    # what the artist sets, which preset and skin that means, and what the engine is told
    "properties", "devices", "hands", "sampling", "placing", "doubts",
    # what came of it, what is shown meanwhile, and what is sent
    "results", "preview", "design", "streaming", "viewport", "timeline",
    # what a person sees and does
    "demos", "jobs", "film", "baking", "comparison", "panels", "operators", "commands",
    # Blender's callbacks
    "views", "handlers", "__init__",
)  # fmt: skip
BLENDER = {"bpy", "bmesh", "mathutils", "bl_ext", "bpy_extras", "gpu", "blf"}
UNSAFE = {"pickle", "shelve", "marshal", "dill", "joblib"}


def module_name(path: Path, root: Path | None = None) -> tuple[str, ...]:
    """Return a file's name inside its package, core where none is given: ('contact', 'gap')."""
    parts = path.relative_to(root or CORE).with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts


def unit_of(name: tuple[str, ...]) -> str:
    """Return the row of the table that a module belongs to: its folder, or itself where it lies loose."""
    if name[:2] in (("devices", "spec"), ("devices", "safe_state"), ("devices", "kinds")):
        return "devices.spec"
    if name[:1] == ("devices",) and name[1:2] and name[1] in MECHANISMS:
        return "devices.mechanisms"
    folder = name if CORE.joinpath(*name).is_dir() else name[:-1]
    return ".".join(folder) or (name[0] if name else "__init__")


def relative_targets(path: Path, tree: ast.AST, root: Path | None = None) -> list[tuple[int, tuple[str, ...]]]:
    """Return the modules that a file's relative imports name (line, name inside core), those in functions included."""
    root = root or CORE
    package = path.relative_to(root).parent.parts
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            assert node.level - 1 <= len(package), f"{path.name}:{node.lineno} imports from above its package"
            base = package[: len(package) - node.level + 1]
            if node.module:
                stem = (*base, *node.module.split("."))
                deeper = [(*stem, a.name) for a in node.names if is_module((*stem, a.name), root)]
                found += [(node.lineno, name) for name in deeper or [stem]]
            else:
                found += [(node.lineno, (*base, alias.name)) for alias in node.names]
    return found


def is_module(name: tuple[str, ...], root: Path) -> bool:
    """Return whether a name inside a package is a module, not something in one."""
    return root.joinpath(*name).with_suffix(".py").is_file() or root.joinpath(*name, "__init__.py").is_file()


def imported_files(path: Path, root: Path) -> set[tuple[str, ...]]:
    """Return the modules of its own package that a file imports; a name that is no module stands for its package."""
    names = (name for _, name in relative_targets(path, parsed(path), root))
    found = {name if is_module(name, root) else (*name[:-1], "__init__") for name in names}
    return found - {module_name(path, root)}


def circles(arrows: dict[tuple[str, ...], set[tuple[str, ...]]]) -> set[tuple[str, ...]]:
    """Return the modules from which imports lead back to themselves."""

    def reached(name: tuple[str, ...]) -> set[tuple[str, ...]]:
        found, pending = set[tuple[str, ...]](), [name]
        while pending:
            new = arrows.get(pending.pop(), set()) - found
            found |= new
            pending += new
        return found

    return {name for name in arrows if name in reached(name)}


def absolute_roots(tree: ast.AST) -> list[tuple[int, str]]:
    """Return the top-level names that a file's absolute imports load."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name.partition(".")[0]) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            found.append((node.lineno, node.module.partition(".")[0]))
    return found


def files(folder: Path) -> list[Path]:
    """Return a package's sources."""
    return sorted(p for p in folder.rglob("*.py") if "__pycache__" not in p.parts)


@functools.cache
def parsed(path: Path) -> ast.Module:
    """Parse one source."""
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


@pytest.mark.parametrize("path", files(CORE), ids=lambda p: p.relative_to(ROOT).as_posix())
def test_core_imports_only_what_the_table_allows(path: Path) -> None:
    tree, unit = parsed(path), unit_of(module_name(path))
    assert unit in MAY_IMPORT or unit in SEES_ALL, f"core/{unit} has no row in the table: decide where it stands"
    wrong = []
    for line, name in relative_targets(path, tree):
        target = unit_of(name)
        if unit not in SEES_ALL and target not in MAY_IMPORT[unit] | {unit}:
            wrong.append(f"line {line}: {unit} must not import {target} ({'.'.join(name)})")
    for line, root in absolute_roots(tree):
        if root in BLENDER:
            wrong.append(f"line {line}: core knows no Blender ({root})")
        if root in UNSAFE:
            wrong.append(f"line {line}: {root} runs what it reads")
        if root in ("core", "tests", "blender_addon"):
            wrong.append(f"line {line}: inside core imports are relative, or the installed extension breaks ({root})")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("path", files(ADDON), ids=lambda p: p.relative_to(ROOT).as_posix())
def test_the_addon_imports_only_from_rooms_above(path: Path) -> None:
    room = module_name(path, ADDON)[0]
    assert room in ROOMS, f"blender_addon/{room} has no place in the order: decide where it stands"
    allowed = set(ROOMS[: ROOMS.index(room) + 1])
    wrong = [
        f"line {line}: {room} must not import {name[0]} ({'.'.join(name)}), which comes after it"
        for line, name in relative_targets(path, parsed(path), ADDON)
        if name[0] not in allowed
    ]
    assert not wrong, "\n".join(wrong)


def test_every_room_of_the_order_is_there() -> None:
    there = {module_name(path, ADDON)[0] for path in files(ADDON)}
    assert there == set(ROOMS) and len(ROOMS) == len(set(ROOMS))


@pytest.mark.parametrize("package", ["core", "blender_addon"])
def test_no_files_import_each_other_in_a_circle(package: str) -> None:
    root = ROOT / package
    found = circles({module_name(path, root): imported_files(path, root) for path in files(root)})
    assert not found, "in a circle: " + ", ".join(sorted(map(".".join, found)))


@pytest.mark.parametrize("path", files(ADDON), ids=lambda p: p.relative_to(ROOT).as_posix())
def test_addon_reaches_the_engine_through_the_seam(path: Path) -> None:
    tree = parsed(path)
    wrong = []
    if path != ADDON / "_core.py":
        wrong += [f"line {n}: core is imported by _core.py only" for n, root in absolute_roots(tree) if root == "core"]
        depth = len(path.relative_to(ADDON).parent.parts)
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.level:
                assert node.level - 1 <= depth, f"line {node.lineno} imports from above the add-on"
                at_top = node.level - 1 == depth
                names = [(node.module or "").partition(".")[0]] if node.module else [a.name for a in node.names]
                if at_top and "core" in names:
                    wrong.append(f"line {node.lineno}: there is no .core in a source checkout; go through _core")
    wrong += [f"line {n}: {root} runs what it reads" for n, root in absolute_roots(tree) if root in UNSAFE]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("path", files(CORE) + files(ADDON), ids=lambda p: p.relative_to(ROOT).as_posix())
def test_nothing_bends_imports_or_runs_text(path: Path) -> None:
    # work/child.py hands the path on to children; __init__.py asks whether the engine is loaded under its other name
    reads = {CORE / "work" / "child.py": "path", CORE / "__init__.py": "modules"}.get(path)
    wrong = []
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "sys":
            if node.attr in ("modules", "path") and node.attr != reads:
                wrong.append(f"line {node.lineno}: sys.{node.attr}")
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("eval", "exec"):
            wrong.append(f"line {node.lineno}: {node.func.id}()")
        if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
            if not (isinstance(node.value, ast.Constant) and node.value.value is False):
                wrong.append(f"line {node.value.lineno}: allow_pickle")
    assert not wrong, "\n".join(wrong)


def test_the_table_has_no_circle() -> None:
    """Layers are layers: following the table never leads back."""
    left = {unit: allowed - {unit} for unit, allowed in MAY_IMPORT.items()}
    while left:
        free = [unit for unit, allowed in left.items() if not allowed & set(left)]
        assert free, f"these may import each other in a circle: {', '.join(sorted(left))}"
        for unit in free:
            del left[unit]


def test_a_breach_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test can fail: a skin that knows contact, inside a function, and a bpy in core are both found."""
    monkeypatch.setitem(globals(), "CORE", tmp_path)
    (tmp_path / "skin").mkdir()
    (tmp_path / "contact").mkdir()
    (tmp_path / "contact" / "gap.py").touch()
    bad = tmp_path / "skin" / "model.py"
    bad.write_text("def f():\n    from ..contact import gap\n    import bpy\n    from core import units\n")
    with pytest.raises(AssertionError, match=r"(?s)skin must not import contact.*no Blender.*relative"):
        test_core_imports_only_what_the_table_allows(bad)


def test_a_breach_of_the_addons_order_and_a_circle_are_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tests can fail: a preview that knows its view, for types and in a function, and two files of one room."""
    monkeypatch.setitem(globals(), "ADDON", tmp_path)
    for name, text in (
        ("preview/rows.py", "from .trail import x\ndef f():\n    from ..viewport import paint\n"),
        ("preview/trail.py", "if TYPE_CHECKING:\n    from .rows import Row\n    from .. import handlers\n"),
        ("viewport/paint.py", "from ..preview import rows\n"),
        ("viewport/draw.py", "from . import paint\n"),
    ):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    with pytest.raises(AssertionError, match="preview must not import viewport"):
        test_the_addon_imports_only_from_rooms_above(tmp_path / "preview" / "rows.py")
    with pytest.raises(AssertionError, match="preview must not import handlers"):
        test_the_addon_imports_only_from_rooms_above(tmp_path / "preview" / "trail.py")
    test_the_addon_imports_only_from_rooms_above(tmp_path / "viewport" / "paint.py")
    found = circles({module_name(p, tmp_path): imported_files(p, tmp_path) for p in files(tmp_path)})
    assert found == {("preview", "rows"), ("preview", "trail"), ("viewport", "paint")}
