"""Windows, as far as it can be tried elsewhere: each test says which call of Windows it stands in for.

None of this ran on Windows. What a stand-in does is what Microsoft's and Python's documentation say of the call.
"""

from __future__ import annotations

import ast
import json
import ntpath
import os
import select
import subprocess
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.errors import DermisError
from core.files import MAX_PATH, write_bytes
from core.presets import Library
from core.stream.links.serial_port import Serial
from core.stream.links.url import Url
from core.track import csv
from core.track.command_track import CommandTrack
from core.track.file_names import LONGEST, FileNames, safe

from .conftest import ROOT

ODD = ["con", "CON", "Aux", "nul", "COM1", "lpt9", "com\u00b9", "a:b", "a?b", 'a"b', "a<b>", "a|b", "a/b\\c", "tail."]
ODD += ["tail ", "", "\u00e4\u00f6", "x" * 300]


@pytest.mark.parametrize("name", ODD)
def test_an_exports_name_is_one_on_windows(name: str) -> None:
    """Stands in for CreateFile: its reserved characters and names, and no dot or blank at the end."""
    made = FileNames().take(f"{safe(name) or 'finger'}.{safe('thimble')}", ".csv")
    assert not set(made) & set('<>:"/\\|?*') and all(ord(c) >= 32 for c in made)
    assert made == made.rstrip(". ") and len(made.encode()) <= LONGEST + 8
    told = getattr(ntpath, "isreserved", None)  # from Python 3.13 on
    assert not (told(made) if told else PureWindowsPath(made).is_reserved())


def test_names_that_differ_by_case_alone_are_two_files() -> None:
    """Stands in for NTFS, which takes 'Index' and 'index' for one."""
    names = FileNames()
    assert len({names.take(stem, ".csv").casefold() for stem in ("Index", "index", "INDEX", "Index-2")}) == 4


@pytest.mark.parametrize("place", ["COM3", "COM12", "\\\\.\\COM12"])
def test_ports_of_windows_are_serial_ports(place: str) -> None:
    assert (Url(place).scheme, Url(place).place) == ("serial", place)
    assert Url(f"serial:{place}?baud=9600").options == {"baud": "9600"}
    assert Url(f"spy://{place}?file=C:\\logs\\a.bin").options == {"file": "C:\\logs\\a.bin"}


class Port:
    """Stands in for pyserial's port on Windows: no file descriptor, a queue that is told by ClearCommError."""

    def __init__(self, *_: Any, **named: Any) -> None:
        assert named["timeout"] == 0 and named["write_timeout"] == 0 and named["exclusive"]
        self.port, self.out_waiting, self.in_waiting, self.sent, self.coming = "", 0, 0, b"", b""

    def open(self) -> None:
        if self.port == "COM4":
            raise PermissionError(13, "Access is denied")

    def write(self, data: bytes) -> int:
        self.sent += data
        return len(data)

    def read(self, count: int = 1) -> bytes:
        taken, self.coming = self.coming[:count], self.coming[count:]
        self.in_waiting = len(self.coming)
        return taken

    def close(self) -> None:
        pass


def test_a_serial_port_without_a_file_descriptor_is_written_and_read(monkeypatch: pytest.MonkeyPatch) -> None:
    import serial

    monkeypatch.setattr(serial, "Serial", Port)
    monkeypatch.delattr(select, "poll", raising=False)
    link = Serial("COM3", 115200)
    port: Any = link._port
    assert link.send(b"abc") and port.sent == b"abc"
    port.coming, port.in_waiting = b"xyz", 3
    assert b"".join(link.receive()) == b"xyz" and link.receive() == []
    port.out_waiting = 100_000
    assert not link.send(b"full"), "what waits in the driver is counted there"
    link.close()
    with pytest.raises(DermisError, match="COM4.*Access is denied"):
        Serial("COM4", 115200)


def test_a_file_that_another_program_has_open_is_told_and_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stands in for MoveFileEx, which does not replace a file that a spreadsheet shows."""

    def denied(*_: Any) -> None:
        raise PermissionError(13, "The process cannot access the file because it is being used by another process")

    path = tmp_path / "track.csv"
    path.write_bytes(b"old")
    monkeypatch.setattr(os, "replace", denied)
    with pytest.raises(DermisError, match="being used by another process.*close the program"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("long", [True, False])
def test_a_path_of_more_than_260_characters_is_told(
    long: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stands in for CreateFile, which says of such a path that there is no such folder; part files count too."""

    def missing(path: Path, *_: Any, **__: Any) -> None:
        raise FileNotFoundError(2, "The system cannot find the path specified", str(path))

    monkeypatch.setattr("core.files._WINDOWS", True)
    monkeypatch.setattr(Path, "open", missing)
    folder = tmp_path / "f" / ("x" * max(MAX_PATH - len(str(tmp_path)) - 20, 1) if long else "x")
    path = folder / "track.csv"
    assert not long or len(str(path)) <= MAX_PATH < len(str(path)) + len(".12345-12345678.part")
    with pytest.raises(DermisError, match="too long for Windows" if long else "cannot find the path") as caught:
        write_bytes(path, b"new")
    assert caught.value.where == str(path)
    assert not long or str(MAX_PATH) in caught.value.limit


def test_paths_on_drives_and_servers_keep_their_names() -> None:
    """Stands in for pathlib on Windows: nothing takes a backslash or a drive's colon for something else."""
    for path in ("C:\\logs\\a.bin", "\\\\server\\share\\a.bin", "\\\\?\\C:\\logs\\a.bin"):
        assert Url(f"spy://COM3?file={path}").options == {"file": path}
        assert PureWindowsPath(path).name == "a.bin" and safe(path) == safe(safe(path))
        assert not set(safe(path)) & set('<>:"/\\|?*')


def test_children_open_no_console_window(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stands in for CreateProcess: the flag reaches it, and no shell comes in between."""
    from core.work import child

    seen: dict[str, Any] = {}

    def started(_self: Any, line: list[str], **named: Any) -> None:
        seen.update(named, line=line)
        raise OSError(2, "stands in")

    monkeypatch.setattr(subprocess, "CREATE_NO_WINDOW", 0x08000000, raising=False)
    monkeypatch.setattr(subprocess.Popen, "__init__", started)
    with pytest.raises(DermisError, match="cannot be started"):
        child.ChildProcess("the sender", child.command("work"))
    assert seen["creationflags"] == 0x08000000 and not seen.get("shell")
    assert seen["line"][1:3] == ["-s", "-m"] and "preexec_fn" not in seen


def test_files_with_line_ends_of_windows_are_read(tmp_path: Path) -> None:
    """As an editor there writes them."""
    spec = Library().device("haptip")
    track = CommandTrack(spec, np.arange(3) / 1000, np.zeros((3, 4)))
    csv.write(track, tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_bytes()
    assert b"\r" not in text, "and none are written, on any system"
    (tmp_path / "b.csv").write_bytes(text.replace(b"\n", b"\r\n"))
    assert np.array_equal(csv.read(tmp_path / "b.csv").values, track.values)
    made = Calibration.of(spec).with_entry("pulley_1", zero=0.1).dumps()
    assert Calibration.loads(made.replace("\n", "\r\n")) == Calibration.loads(made)
    assert json.loads(made)["schema"]


def opens(tree: ast.AST) -> list[ast.Call]:
    """Return the calls that read or write text."""
    found = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in ("read_text", "write_text") or (name == "open" and isinstance(node.func, ast.Name)):
            modes = [a.value for a in node.args[1:2] if isinstance(a, ast.Constant) and isinstance(a.value, str)]
            modes += [k.value.value for k in node.keywords if k.arg == "mode" and isinstance(k.value, ast.Constant)]
            if not any("b" in str(mode) for mode in modes):
                found.append(node)
    return found


@pytest.mark.one_line("3.11", "the text of the sources is read")
def test_no_text_is_read_or_written_in_the_code_page_of_the_system() -> None:
    """Windows has cp1252 and others: a name with an umlaut would be another one there."""
    paths = [*(ROOT / "core").rglob("*.py"), *(ROOT / "blender_addon").rglob("*.py"), ROOT / "build_addon.py"]
    bare = []
    for path in (*paths, ROOT / ".ci" / "zips.py"):
        for call in opens(ast.parse(path.read_text(encoding="utf-8"))):
            ours = isinstance(call.func, ast.Name) and call.func.id != "open"  # of core.files: UTF-8
            if not ours and not any(k.arg == "encoding" for k in call.keywords):
                bare.append(f"{path.relative_to(ROOT)}:{call.lineno}")
    assert not bare, bare
