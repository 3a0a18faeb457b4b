"""The serial number of a port's USB adapter reaches whoever asks which built device it is."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from core.stream.links.serial_port import Serial, serial_number


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> str:
    """A real port, of which the system says that it is one of two USB adapters."""
    _, slave = os.openpty()
    name = os.ttyname(slave)
    found = []
    for device, number in ((f"{name}0", "another"), (name, "7573530323135"), ("/dev/ttyS0", None)):
        info = ListPortInfo(device)
        info.serial_number = number
        found.append(info)
    monkeypatch.setattr(list_ports, "comports", lambda: found)
    return name


def test_a_port_is_known_by_any_of_its_names(port: str, tmp_path: Path) -> None:
    (tmp_path / "by-id").symlink_to(port)
    assert serial_number(port) == serial_number(str(tmp_path / "by-id")) == "7573530323135"
    assert serial_number("/dev/ttyS0") == serial_number("/dev/nowhere") == ""


def test_an_open_port_reports_it(port: str, monkeypatch: pytest.MonkeyPatch) -> None:
    link = Serial(port, 115200)
    try:
        assert link.report() == {"usb_serial": "7573530323135"}
    finally:
        link.close()
    monkeypatch.setattr(list_ports, "comports", list)
    link = Serial(port, 115200)
    try:
        assert link.report() == {}
    finally:
        link.close()
