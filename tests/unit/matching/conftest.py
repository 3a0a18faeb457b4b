"""What tests of matching share: the thimble, as a preset and as a mechanism."""

from __future__ import annotations

import pytest

from core.devices.spec import DeviceSpec
from core.devices.thimble import Thimble, mechanism
from core.presets import Library


@pytest.fixture(scope="session")
def spec() -> DeviceSpec:
    """The 3-RRS thimble as it ships."""
    return Library().device("thimble_3rrs")


@pytest.fixture(scope="session")
def device(spec: DeviceSpec) -> Thimble:
    """Its mechanism."""
    return mechanism(spec)
