"""Mutation testing: change one thing of the engine, run the tests that fit, and see whether any of them notices.

`python3 build_addon.py test --mutate 40 --seed 7` draws forty changes of operators, constants and calls. Each is made
in a copy of the tree. A change that no test notices SURVIVED: either it does not matter, or a test is missing.
"""

from __future__ import annotations

import argparse
import ast
import functools
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from tests.mutants import Mutation, mutations

ROOT = Path(__file__).resolve().parents[1]
TREE = ("core", "blender_addon", "presets", "tests", ".ci", "build_addon.py", "pyproject.toml", "README.md", "LICENSE")
TIME_LIMIT = 300.0  # [s] of the tests of one mutant
MEMORY_LIMIT = 8 << 30  # [bytes] of one process of them


def drawn(count: int, seed: int, below: Sequence[Path], root: Path = ROOT) -> list[Mutation]:
    """Return so many changes of files, or of the files below folders; the same seed draws the same."""
    files = sorted({file for path in below for file in ([path] if path.is_file() else path.rglob("*.py"))})
    every = [m for file in files for m in mutations(file.relative_to(root).as_posix(), file.read_bytes())]
    return random.Random(seed).sample(every, min(count, len(every)))


# -- which tests fit --------------------------------------------------------------------------------------------------


@functools.cache
def imported(path: Path) -> set[str]:
    """Return the modules that a file names in its imports, 'core.units' for a name out of it as well."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def fitting(path: str) -> list[str]:
    """Return the test files that fit a file of core: those that import it, its namesakes first, then its folder's.

    Tests of a folder import it as a whole, or lie in the mirrored one.
    """
    module = path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    unit, inside = ROOT / "tests" / "unit", Path(path).parent.relative_to("core")
    imports = {p: imported(p) for p in sorted(unit.rglob("test_*.py"))}
    package = module.rpartition(".")[0]
    direct = sorted((p for p, names in imports.items() if module in names), key=lambda p: Path(path).stem not in p.stem)
    direct += [p for p, names in imports.items() if package in names and package != "core"]
    return [
        p.relative_to(ROOT).as_posix() for p in dict.fromkeys([*direct, *sorted((unit / inside).glob("test_*.py"))])
    ]


# -- the run ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Verdict:
    """What became of a mutant: 'killed', 'SURVIVED' or 'timeout', by which test, after how long [s]."""

    fate: str
    by: str
    seconds: float


def judge(mutation: Mutation, limit: float = TIME_LIMIT) -> Verdict:
    """Make a change in a copy of the tree and run the tests that fit; what kills it must pass without it."""
    started = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="dermis-mutant-") as scratch:
        tree = Path(scratch) / "tree"
        for name in TREE:
            _copy(ROOT / name, tree / name)
        file, tests = tree / mutation.path, fitting(mutation.path)
        whole = file.read_bytes()
        anyway: list[str] = []  # tests that fail without the change as well say nothing of it
        while True:
            file.write_bytes(mutation.applied(whole))
            status, failed = _run([*tests, *(f"--deselect={test}" for test in anyway)], tree, limit)
            file.write_bytes(whole)
            if status != "failed" or failed in anyway or _run([failed], tree, limit)[0] == "passed":
                break
            anyway.append(failed)
    fate = "SURVIVED" if status == "passed" or failed in anyway else {"failed": "killed"}.get(status, status)
    by = failed if fate == "killed" else f"({len(tests)} test files; {len(anyway)} tests fail without it)"
    return Verdict(fate, by, time.monotonic() - started)


def _run(tests: list[str], tree: Path, limit: float) -> tuple[str, str]:
    """Run tests until one fails; return 'passed', 'failed' or 'timeout', and the test that failed."""
    if not tests:
        return "passed", ""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--tb=no", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "HOME": str(tree.parent)}
    options = {"start_new_session": True, "preexec_fn": _within_memory} if os.name == "posix" else {}
    child = subprocess.Popen(command, cwd=tree, env=environment, stdout=-1, stderr=subprocess.STDOUT, **options)  # type: ignore[call-overload]
    try:
        told = child.communicate(timeout=limit)[0].decode("utf-8", "replace")
    except subprocess.TimeoutExpired:
        return "timeout", ""
    finally:
        _end(child)
    if child.returncode in (0, 5):  # 5: all of them were left out
        return "passed", ""
    failed = [line.split(" ", 1)[1] for line in told.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    return "failed", failed[0].split(" - ")[0] if failed else tests[0]


def _within_memory() -> None:
    """Keep a mutant that allocates without end from taking the machine with it."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))


def _end(child: subprocess.Popen[bytes]) -> None:
    """End a run of tests and what it started."""
    try:
        if os.name == "posix":
            os.killpg(child.pid, signal.SIGKILL)
        else:
            child.kill()
    except ProcessLookupError:
        pass
    child.wait()


def _copy(source: Path, target: Path) -> None:
    if source.is_dir():
        shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
    elif source.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)


def main(arguments: list[str] | None = None) -> int:
    """Draw the mutants, judge them, print a line for each and the score."""
    parser = argparse.ArgumentParser(prog="test --mutate", description=__doc__)
    parser.add_argument("count", type=int, help="how many")
    parser.add_argument("--seed", type=int, default=0, help="of the draw (0)")
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time (1)")
    parser.add_argument("--below", type=Path, action="append", help="only of this folder or file (core; repeatable)")
    options = parser.parse_args(arguments)
    mutants = drawn(options.count, options.seed, [path.resolve() for path in options.below or [ROOT / "core"]])
    fates = []
    with ThreadPoolExecutor(max(options.jobs, 1)) as pool:
        for mutant, verdict in zip(mutants, pool.map(judge, mutants), strict=True):
            fates.append(verdict.fate)
            place = f"{mutant.path}:{mutant.line}"
            print(f"{verdict.fate:8} {place:44} {mutant.what}\n{'':9}{verdict.by}  {verdict.seconds:.0f} s", flush=True)
    noticed = sum(fate != "SURVIVED" for fate in fates)
    print(f"mutation score: {noticed} of {len(fates)} noticed ({fates.count('timeout')} by running out of time)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
