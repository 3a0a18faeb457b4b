"""What tests of every folder share."""

from __future__ import annotations

import pytest

from core.skin.model import SkinModel, fingertip_skin


@pytest.fixture(scope="session")
def skin() -> SkinModel:
    """The average fingertip, coarse enough for a test."""
    return fingertip_skin(level="draft")
