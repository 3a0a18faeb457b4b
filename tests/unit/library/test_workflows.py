"""The hosts' workflows cannot run here: what they name is there, and they are what GitHub would read."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import build_addon

from .commands import commands, understood
from .conftest import ROOT

FOLDER = ROOT / ".github" / "workflows"
WORKFLOWS = sorted(FOLDER.glob("*.yml"))
WORKFLOW = (FOLDER / "ci.yml").read_text(encoding="utf-8")
RUNNERS = {"ubuntu-24.04", "windows-2022", "macos-14"}
CONTEXTS = {"matrix", "env", "github", "runner", "needs"}  # that these workflows may ask


def test_the_hosts_workflow_runs_what_there_is() -> None:
    found = commands(WORKFLOW)
    assert [".ci/run"] in found and ["python", "build_addon.py", "test"] in found
    for words in found:
        understood(words)
    for line in {f"{a}.{b}" for a, b in build_addon.BLENDER}:
        assert WORKFLOW.count(f'"{line}"') == 1 and re.search(rf"^ +{re.escape(line)}$", WORKFLOW, re.M), line
    run = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    firmware = re.search(r"firmware_packages=\(([^)]*)\)", run)
    assert firmware
    for package in [*firmware[1].split(), *" ".join(build_addon.NEEDED_LIBRARIES.values()).split()]:
        assert re.search(rf"(?<![\w-]){re.escape(package)}(?![\w-])", WORKFLOW), f"{package} is not installed"


def test_the_workflow_of_blenders_builds_runs_what_there_is() -> None:
    """It has not run yet, so at least its files, its commands and both lines are there."""
    text = (ROOT / ".github" / "workflows" / "blender.yml").read_text(encoding="utf-8")
    for name in set(re.findall(r"(?:tests|core|\.ci)/[\w./-]+", text)):
        assert (ROOT / name).exists(), name
    for words in commands(text):
        understood(words)
    assert ["python", "build_addon.py", "build", "--out", "dist"] in commands(text)
    for line in build_addon.zips.LINES.values():
        assert text.count(f"[{line.name},") == 2 or text.count(f", {line.name}]") == 2
    for target in ("windows-x64", "macos-arm64"):
        assert f"PLATFORM={target}" in text and target in build_addon.PLATFORMS


def read(path: Path) -> dict[Any, Any]:
    """Return a workflow as GitHub reads it."""
    yaml = pytest.importorskip("yaml", reason="the reader of YAML comes with the dask of sweeps")
    found: dict[Any, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return found


def steps(workflow: dict[Any, Any]) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Return each step, with the name of its job and the job."""
    for name, job in workflow["jobs"].items():
        for step in job["steps"]:
            yield name, job, step


def runners(job: dict[str, Any]) -> list[str]:
    """Return the systems that a job runs on."""
    asked = re.fullmatch(r"\$\{\{ matrix\.(\w+) \}\}", job["runs-on"])
    return job["strategy"]["matrix"][asked[1]] if asked else [job["runs-on"]]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.name)
def test_a_workflow_is_what_the_host_reads(path: Path) -> None:
    workflow = read(path)
    # YAML 1.1 reads the key `on` as true
    assert (
        {"name", True, "permissions", "jobs"}
        <= set(workflow)
        <= {"name", True, "permissions", "jobs", "env", "concurrency"}
    )
    assert workflow["permissions"] == {"contents": "read"}, "it writes nothing to the repository"
    known = {"runs-on", "timeout-minutes", "steps", "strategy", "needs", "defaults"}
    for name, job in workflow["jobs"].items():
        assert {"runs-on", "timeout-minutes", "steps"} <= set(job) <= known, name
        assert set(runners(job)) <= RUNNERS, name
        needed = job.get("needs", [])
        assert set([needed] if isinstance(needed, str) else needed) <= set(workflow["jobs"]) - {name}
    for name, _, step in steps(workflow):
        assert ("uses" in step) != ("run" in step), f"{name}: a step uses an action or runs commands"
        assert set(step) <= {"name", "uses", "with", "run", "env"}, step
        assert "uses" not in step or re.fullmatch(r"actions/[\w-]+@v\d+", step["uses"]), step


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.name)
def test_what_a_workflow_asks_is_there(path: Path) -> None:
    """Each ${{ }} asks a key of the matrix or a variable that is set; a job before uploads what is downloaded."""
    workflow = read(path)
    assert not re.search(r"\$\{\{(?![^}]*\}\})", path.read_text(encoding="utf-8")), "one that is not closed"
    kept: dict[str, set[str]] = {}  # what each job uploads
    for name, job, step in steps(workflow):
        axes = set(job.get("strategy", {}).get("matrix", {}))
        for asked in re.findall(r"\$\{\{(.*?)\}\}", str(step) + str(job["runs-on"])):
            for context, key in re.findall(r"\b([a-z]+)\.([\w-]+)", re.sub(r"'[^']*'", "", asked)):
                assert context in CONTEXTS, asked
                assert context != "matrix" or key in axes, f"{name}: {asked}"
                assert context != "env" or key in workflow["env"], f"{name}: {asked}"
        made = step.get("with", {}).get("name", "")
        if step.get("uses", "").startswith("actions/upload-artifact"):
            kept.setdefault(name, set()).add(made)
        if step.get("uses", "").startswith("actions/download-artifact"):
            assert made in set().union(*(kept[before] for before in _before(workflow, name))), f"{name}: {made}"


def _before(workflow: dict[Any, Any], name: str) -> Iterator[str]:
    """Return the jobs that have ended when one begins."""
    needed = workflow["jobs"][name].get("needs", [])
    for before in [needed] if isinstance(needed, str) else needed:
        yield before
        yield from _before(workflow, before)


@pytest.mark.skipif(shutil.which("bash") is None, reason="the steps are read by bash")
@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.name)
def test_bash_reads_what_steps_run(path: Path) -> None:
    for name, _, step in steps(read(path)):
        text = re.sub(r"\$\{\{.*?\}\}", "VALUE", step.get("run", ""))
        done = subprocess.run(["bash", "-n"], input=text, capture_output=True, text=True)
        assert done.returncode == 0, f"{name}: {done.stderr}"


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.name)
def test_steps_on_windows_that_are_written_for_bash_say_so(path: Path) -> None:
    """GitHub runs steps there in PowerShell, which knows neither `$NAME` nor `mkdir` of two folders."""
    for name, job, step in steps(read(path)):
        shell = job.get("defaults", {}).get("run", {}).get("shell", "")
        plain = re.fullmatch(r"[\w./ -]+", step.get("run", "plain"))
        assert "windows-2022" not in runners(job) or shell == "bash" or plain, f"{name}: {step}"


def test_scripts_that_steps_call_take_what_they_are_given() -> None:
    """Options and files that come after `--`, in the words of the scripts' own parsers."""
    text = (FOLDER / "blender.yml").read_text(encoding="utf-8")
    walk = (ROOT / "tests" / "extension" / "walkthrough.py").read_text(encoding="utf-8")
    for options in re.findall(r"walkthrough\.py -- (.*)$", text, re.M):
        for option in re.findall(r"--[\w-]+", options):
            assert f'"{option}"' in walk, option
    assert re.search(r'"kernels": kernels', walk) and "json.load(open('report.json'))['kernels']" in text
