"""presets/scale.md: its five commands, run as they stand there on a cluster of this machine; the array script, too."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import build_addon
from core.scene import scene_file
from core.work.child import environment
from tests.clusters import MISSING, WORKERS, has_dask
from tests.unit.library.test_pages import understood
from tests.unit.pipeline.test_shots import files, press

pytestmark = pytest.mark.one_line(
    "3.13", "the page's commands are those of every Python; verbs and clusters are tested on both lines"
)

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "presets" / "scale.md").read_text(encoding="utf-8")
SCRIPT = ROOT / "presets" / "slurm_array.sh"
BLOCKS = re.findall(r"^```sh\n(.*?)^```", PAGE, re.S | re.M)
COMMANDS = BLOCKS[0].replace("\\\n", "").splitlines()
SET = [f"{name}={value}" for name, value in WORKERS.items()]  # in front of a worker's command
posix = pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX shell")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    for number in range(2):
        scene_file.save(press(number), tmp_path / "shots" / f"shot_{number}.npz")
    (spec,) = re.findall(r"^```toml\n(.*?)^```", PAGE, re.S | re.M)
    (tmp_path / "sweep.toml").write_text(spec)
    return tmp_path


def words_of(command: str, home: Path, address: str) -> list[str]:
    """Return a command of the page as it is run here: this Python, this engine, another port, a shell's patterns."""
    words = [word.replace("tcp://127.0.0.1:8786", address) for word in shlex.split(command) if word not in SET]
    head = {"python": [sys.executable], "dask": [sys.executable, "-m", "dask"]}[words[0]]
    words = [*head, *("core" if word == "dermis" else word for word in words[1:])]
    return [each for word in words for each in (sorted(map(str, home.glob(word))) if "*" in word else [word])]


def run(words: list[str], home: Path) -> str:
    done = subprocess.run(words, env=environment(), cwd=home, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stderr


def test_five_commands_go_from_one_machine_to_a_cluster(home: Path) -> None:
    if not has_dask():
        pytest.skip(MISSING)
    assert len(COMMANDS) == 5
    alone, scheduler, worker, together, sweep = COMMANDS
    assert shlex.split(worker)[: len(SET)] == SET
    run(words_of(alone, home, ""), home)
    made = files(home / "tracks")
    assert len(made) == 2 * 2
    shutil.rmtree(home / "tracks")
    told, started = home / "scheduler.json", []
    try:
        words = words_of(scheduler, home, "")
        words[words.index("8786")] = "0"  # whatever port is free
        started.append(
            subprocess.Popen(
                [*words, "--scheduler-file", str(told)], env=environment(), cwd=home, stderr=subprocess.DEVNULL
            )
        )
        end = time.monotonic() + 60.0
        while not (told.exists() and told.read_text()):
            assert time.monotonic() < end and started[0].poll() is None
            time.sleep(0.05)
        address = json.loads(told.read_text())["address"]
        assert address.startswith("tcp://127.0.0.1:"), "not open to others"
        started.append(
            subprocess.Popen(
                words_of(worker, home, address), env=environment() | WORKERS, cwd=home, stderr=subprocess.DEVNULL
            )
        )
        said = run(words_of(together, home, address), home)
        assert "a worker has" not in said and "encrypted" not in said and " at once" in said
        assert files(home / "tracks") == made
        assert "8 rows: 8 done" in run(words_of(sweep, home, address), home)
        assert "8 rows: 0 done, 8 there before" in run(words_of(sweep, home, address), home)
    finally:
        for process in reversed(started):  # the scheduler last: a worker that has lost it waits for it
            process.terminate()
            process.wait(30)


def test_every_command_of_the_page_is_understood() -> None:
    for line in filter(None, "\n".join(BLOCKS).replace("\\\n", "").splitlines()):
        understood([word for word in shlex.split(line) if word not in SET])
    for name in re.findall(r"\]\(([^)#:]+)\)", PAGE):
        assert (ROOT / "presets" / name).exists(), name


def test_the_page_says_what_the_engine_does() -> None:
    from core.sweep.devices import SETTINGS
    from core.sweep.motors import DEFAULTS

    rows = {key for line in PAGE.splitlines() if line.startswith("|") for key in re.findall(r"`\"?([\w.]+)\"?`", line)}
    assert {"device", "skin", *(f"{kind}.NAME" for kind in SETTINGS), *DEFAULTS} <= rows
    assert "allowed-failures" in PAGE and "10.0.0.1" in PAGE


def test_nothing_of_dask_is_in_the_extension() -> None:
    wheels = (ROOT / ".ci" / "wheels.txt").read_text(encoding="utf-8")
    assert not re.search(r"^(dask|distributed)\b", wheels, re.M)
    assert re.search(r"^distributed==", (ROOT / ".ci" / "dask.txt").read_text(encoding="utf-8"), re.M)
    names = [path for path in build_addon.zips.sources() if "dask" in path]
    assert not names


# -- Slurm, by a stand-in: a loop that sets what Slurm would


@posix
def test_the_array_script_renders_every_shot_once_whatever_the_number_of_tasks(home: Path) -> None:
    scene_file.save(press(2), home / "shots" / "shot_2.npz")
    more = {"DERMIS_PYTHON": sys.executable, "DERMIS_PACKAGE": "core"}

    def task(number: int, tasks: int) -> int:
        array = {"SLURM_ARRAY_TASK_ID": str(number), "SLURM_ARRAY_TASK_COUNT": str(tasks), "SLURM_ARRAY_TASK_MIN": "1"}
        line = ["bash", str(SCRIPT), str(home / "shots"), str(home / "tracks")]
        return subprocess.run(line, env={**environment(), **more, **array}, capture_output=True).returncode

    assert [task(number, 2) for number in (1, 2)] == [0, 0]
    made = files(home / "tracks")
    assert {name.partition("/")[0] for name in made} == {"shot_0", "shot_1", "shot_2"} and len(made) == 6
    at = {path: path.stat().st_mtime_ns for path in (home / "tracks").rglob("*.csv")}
    shutil.rmtree(home / "tracks" / "shot_1")
    (home / "shots" / "shot_9.npz").write_bytes(b"no scene")
    assert task(1, 1) == 2, "a broken shot is told"
    assert files(home / "tracks") == made, "and takes no other down, nor leaves anything behind"
    assert all(path.stat().st_mtime_ns == then for path, then in at.items() if "shot_1" not in path.parts)


@posix
def test_the_array_script_passes_shellcheck() -> None:
    assert subprocess.run(["bash", "-n", str(SCRIPT)]).returncode == 0 and os.access(SCRIPT, os.X_OK)
    beside = os.pathsep.join(str(Path(folder) / "bin") for folder in sys.path)  # see .ci/sweep.txt
    found = shutil.which("shellcheck") or shutil.which("shellcheck", path=beside)
    if not found:
        pytest.skip("THE ARRAY SCRIPT IS NOT CHECKED: there is no shellcheck (see .ci/sweep.txt)")
    done = subprocess.run([found, str(SCRIPT)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
