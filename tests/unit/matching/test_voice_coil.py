"""A voice coil on a finger: [S3] eq. 1 and 2 along one axis, down to what an actuator makes of the WAV file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import wavfile

from core.matching.rendered import Rendered
from core.matching.voice_coil import render
from core.presets import Library
from core.scene.tactile_scene import Body, DeviceUse
from core.track import export
from tests.unit.devices.test_voice_coil import measured, moved
from tests.unit.matching.test_shear_tactor import QUIET, TABLE, T, path, poses, swept

SPEC = Library().device("voice_coil")
RATE, RANGE = 8000.0, 0.12e-3
TAPPED = QUIET | {
    "transient_on": True,
    "transient_amplitude": 0.5,
    "transient_decay": 90.0,
    "transient_frequency": 200.0,
}
STRIPED = QUIET | {
    "texture_on": True,
    "texture_amplitude_x": 0.4,
    "texture_amplitude_y": 0.0,
    "texture_period_x": 1e-3,
    "friction": 0.5,
}


def baked(
    at: np.ndarray, material: Mapping[str, Any], use: Mapping[str, Any] | None = None, linear: Any = None
) -> Rendered:
    device = DeviceUse("voice_coil", use or {})
    touch, scene = swept([poses(at, linear)], [(Body("b", TABLE, material), poses(path()))], device)
    return render(touch, scene, 0, device, SPEC)


def tap(linear: Any = None, **use: Any) -> tuple[Rendered, float]:
    """A finger that comes down into a table at 0.2 m/s; and the instant of contact."""
    return baked(path(z=0.09 - 0.2 * T), TAPPED, use, linear), (0.05 - 0.0005) / 0.2


def stroke(speed: float = 0.2, **material: Any) -> Rendered:
    """A finger that slides along the table's X from the first moment on."""
    return baked(path(x=speed * (T - 0.5), z=0.0402), STRIPED | material)


def test_a_tap_is_the_decaying_sine_of_its_speed_whatever_its_direction() -> None:
    rendered, onset = tap()
    since = rendered.track.times - onset
    wave = np.where(since > 0, -0.5 * 0.2 * np.exp(-90 * since) * np.sin(2 * np.pi * 200 * since), 0.0)
    before_it_leaves = rendered.track.times < 0.6525
    found = rendered.track.column("displacement")
    assert found[before_it_leaves] == pytest.approx(RANGE * wave[before_it_leaves], abs=1e-9)
    turned = tap(np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]]))[0]  # the pad's X comes down first
    assert turned.track.column("displacement") == pytest.approx(found, abs=1e-9)


def test_a_texture_is_its_height_under_the_pad() -> None:
    rendered = stroke()
    x = 0.2 * (rendered.track.times - 0.5)
    wave = -RANGE * 0.5 * 0.4 * np.sin(2 * np.pi * x / 1e-3)
    set_in = 0.5 - 0.5 * np.cos(np.pi * np.minimum((np.arange(len(x)) + 1) / 160, 1.0))  # over 20 ms
    assert rendered.track.column("displacement") == pytest.approx(wave * set_in, abs=1e-9)
    assert rendered.signals["contact"].all() and not rendered.track.limited


def test_an_actuator_makes_of_the_wav_file_what_the_formula_says(tmp_path: Path) -> None:
    """200 Hz of a texture: within 0.5 % behind bake, file, a reader of others and a mass on a spring."""
    coil, rendered = measured(), stroke()
    rows = np.column_stack([rendered.track.column("displacement"), coil.volts(rendered.track.column("displacement"))])
    export.write(replace(rendered.track, values=rows), tmp_path / "t.wav", "wav", settings={"full_scale": 6.0})
    rate, counts = wavfile.read(tmp_path / "t.wav")
    made = moved(counts / 2.0**31 * 6.0, rate)
    t = np.arange(len(made)) / rate
    late = (t > 0.4) & (t < 0.9)
    amplitude = 2.0 * abs(np.mean(made[late] * np.exp(-2j * np.pi * 200.0 * t[late])))
    assert amplitude == pytest.approx(RANGE * 0.5 * 0.4, rel=5e-3)


def test_a_texture_begins_and_ends_without_a_knock() -> None:
    """It would jump by its height there; the coil's lowest frequency has 20 ms a period, and so long it takes."""
    z = 0.0402 + np.maximum(np.abs(T - 0.45) - 0.15, 0.0) ** 2
    at = path(x=0.2 * (T - 0.5) + 0.23e-3, z=z)
    rendered = baked(at, STRIPED)
    touching = rendered.signals["contact"] > 0.5
    displacement = rendered.track.column("displacement")
    start, end = int(np.argmax(touching)), len(touching) - int(np.argmax(touching[::-1]))
    step = 2 * np.pi * 200.0 / RATE  # of the texture's own phase, in a sample
    fastest, bent = RANGE * 0.2 * step, RANGE * 0.2 * step**2
    assert np.abs(np.diff(displacement)).max() <= 1.3 * fastest
    assert np.abs(np.diff(displacement, 2)).max() <= 3.5 * bent, "by a jump it would be 5 times as much"
    assert not displacement[:start].any() and displacement[end] != 0.0 and not displacement[end + 160 :].any()
    peak = np.abs(rendered.track.column("voltage")[start + 400 : end - 10]).max()
    assert np.abs(rendered.track.column("voltage")).max() <= 3.0 * peak


def test_only_what_a_coil_can_make_is_rendered_and_switches_hold() -> None:
    heavy = {"weight_on": True, "weight_gravity": 0.1, "held_mode": "keyed", "held": True}
    assert not baked(path(z=0.0402), QUIET | heavy).track.values.any()
    assert not tap(use_transient=False)[0].track.values.any()
    touch, scene = swept(
        [poses(path(z=0.5))],
        [(Body("b", TABLE), poses(path()))],
        DeviceUse("voice_coil"),
        {"pattern": "orientation", "pattern_play": 1.0},
    )
    assert not render(touch, scene, 0, DeviceUse("voice_coil"), SPEC).track.values.any()


def test_beyond_the_range_is_limited_and_counted() -> None:
    rendered = stroke(texture_amplitude_x=4.0)
    displacement = rendered.track.column("displacement")
    assert np.abs(displacement).max() == pytest.approx(RANGE)
    assert rendered.track.limited["displacement.range"] == int((rendered.signals["magnitude"] > 1 + 1e-9).sum()) > 0


def test_frequencies_that_the_coil_hardly_makes_are_told() -> None:
    slow = next(f for f in stroke(0.01).findings if f.code == "outside-band")
    assert slow.severity == "warning" and "texture" in slow.what and "10 to 10 Hz" in str(slow.value)
    assert "50 to 1000 Hz" in slow.limit
    assert not stroke().findings and not tap()[0].findings
    low = baked(path(z=0.09 - 0.2 * T), TAPPED | {"transient_frequency": 20.0})
    assert [f.code for f in low.findings] == ["outside-band"] and "contact transient" in low.findings[0].what
    quiet = baked(path(z=0.09 - 0.2 * T), TAPPED | {"transient_frequency": 20.0, "transient_amplitude": 0.0})
    assert not quiet.findings
