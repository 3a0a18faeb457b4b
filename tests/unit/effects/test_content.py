"""What moves inside, against closed forms: periods, decay, energy, restitution."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.effects.content import bounce, displacement, exponential, loose, oscillator, pendulum, slosh
from core.errors import DermisError

GRAVITY = np.array([0.0, 0.0, -9.81])
TIMES = np.arange(10001) / 1000.0
STILL = np.zeros((10001, 3))
UPRIGHT = np.broadcast_to(np.eye(3), (10001, 3, 3))


def jolt(angle: float, length: float) -> np.ndarray:
    """A jolt at the first sample that leaves a pendulum with the energy of a release at an angle."""
    acceleration = STILL.copy()
    speed = math.sqrt(2 * 9.81 * length * (1 - math.cos(angle)))
    acceleration[0, 0] = -2.0 * speed / 1e-3  # half a step's impulse
    return acceleration


def crossings(x: np.ndarray) -> np.ndarray:
    i = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    return TIMES[i] + 1e-3 * x[i] / (x[i] - x[i + 1])


def test_equation_5() -> None:
    assert displacement(np.array([[0.01, 0.0, -0.02]]), 20.0) == pytest.approx(np.array([[0.2, 0.0, -0.4]]))


def test_small_swing_has_the_period_of_the_closed_form() -> None:
    x = pendulum(TIMES, jolt(0.01, 0.1), GRAVITY, 0.1, 0.0)[:, 0]
    period = np.diff(crossings(x)).mean()
    assert period == pytest.approx(2 * math.pi * math.sqrt(0.1 / 9.81) * (1 + 0.01**2 / 16), rel=2e-5)


def test_large_swing_has_the_period_of_the_elliptic_integral() -> None:
    angle = 2.0
    x = pendulum(TIMES, jolt(angle, 0.1), GRAVITY, 0.1, 0.0)[:, 0]
    a, b = 1.0, math.cos(angle / 2)  # T = 2 pi sqrt(l/g) / agm(1, cos(angle/2))
    while abs(a - b) > 1e-15:
        a, b = (a + b) / 2, math.sqrt(a * b)
    assert np.diff(crossings(x)).mean() == pytest.approx(2 * math.pi * math.sqrt(0.1 / 9.81) / a, rel=1e-4)


def test_undamped_pendulum_keeps_length_and_height() -> None:
    r = pendulum(TIMES, jolt(1.2, 0.1), GRAVITY, 0.1, 0.0)
    assert np.linalg.norm(r, axis=1) == pytest.approx(0.1, abs=1e-12)
    top = -0.1 * math.cos(1.2)
    assert r[:, 2].max() == pytest.approx(top, abs=1e-5)
    assert r[9000:, 2].max() == pytest.approx(top, abs=1e-5)  # no drift


def test_damped_swing_decays_as_its_ratio_says() -> None:
    omega, zeta = math.sqrt(9.81 / 0.1), 0.05
    x = pendulum(TIMES[:3001], jolt(0.01, 0.1)[:3001], GRAVITY, 0.1, zeta)[:, 0]
    damped = omega * math.sqrt(1 - zeta**2)
    t = TIMES[:3001]
    exact = np.exp(-zeta * omega * t) * np.sin(damped * t)
    scale = x[100] / exact[100]
    assert np.abs(x - scale * exact).max() < 2e-3 * abs(scale)


def test_accelerated_pivot_tilts_the_rest() -> None:
    pushed = np.tile([3.0, 0.0, 0.0], (10001, 1))
    r = pendulum(TIMES, pushed, GRAVITY, 0.1, 0.5)[-1]
    felt = GRAVITY - [3.0, 0, 0]
    assert r == pytest.approx(0.1 * felt / np.linalg.norm(felt), abs=1e-9)
    assert pendulum(TIMES, STILL, GRAVITY, 0.1, 0.0)[-1] == pytest.approx([0, 0, -0.1])


def test_free_fall_lets_the_pendulum_float() -> None:
    falling = np.tile(GRAVITY, (10001, 1))
    falling[0, 0] = -2 * 0.2 / 1e-3  # 0.2 m/s sideways: then it goes round at constant speed
    r = pendulum(TIMES, falling, GRAVITY, 0.1, 0.0)
    angle = 2.0 * TIMES
    assert r[:, 0] == pytest.approx(0.1 * np.sin(angle), abs=1e-9)


def test_swinging_over_the_top_for_a_minute_stays_on_the_sphere() -> None:
    t = np.arange(60_001) / 1000.0
    kick = np.zeros((60_001, 3))
    kick[0] = [-2 * 2.5 / 1e-3, 0.3 / 1e-3, 0.0]
    r = pendulum(t, kick, GRAVITY, 0.1, 0.0)
    assert np.linalg.norm(r, axis=1) == pytest.approx(0.1, abs=1e-12)
    speed = np.linalg.norm(np.gradient(r, t, axis=0), axis=1)[1:-1]
    energy = speed**2 / 2 + 9.81 * r[1:-1, 2]
    assert np.ptp(energy) < 5e-3 * (2.5**2 / 2)


@pytest.mark.parametrize("zeta", [0.0, 0.05, 1.0, 3.0])
def test_oscillator_is_exact_for_steps_and_ramps(zeta: float) -> None:
    omega, t = 9.0, TIMES[:4001]
    x = oscillator(1e-3, np.stack([np.ones_like(t), t], axis=1), omega, zeta)
    roots = np.roots([1.0, 2 * zeta * omega, omega**2]).astype(complex)
    if abs(zeta - 1.0) < 1e-9:
        step = (1 - np.exp(-omega * t) * (1 + omega * t)) / omega**2
        ramp = (t - 2 / omega + np.exp(-omega * t) * (t + 2 / omega)) / omega**2
    else:
        p, q = roots
        step = (1 / (p * q) + np.exp(p * t) / (p * (p - q)) + np.exp(q * t) / (q * (q - p))).real
        ramp = (
            t / (p * q) + (p + q) / (p * q) ** 2 + np.exp(p * t) / (p**2 * (p - q)) + np.exp(q * t) / (q**2 * (q - p))
        ).real
    assert x[:, 0] == pytest.approx(step, abs=1e-12) and x[:, 1] == pytest.approx(ramp, abs=1e-11)


def test_exponential_against_mpmath() -> None:
    import mpmath

    matrix = np.random.default_rng(0).normal(size=(4, 4)) * 3
    exact = np.array(mpmath.expm(mpmath.matrix(matrix.tolist())).tolist(), dtype=float)
    assert exponential(matrix) == pytest.approx(exact, rel=1e-12)


def test_liquid_lags_on_the_level_and_is_stopped_by_walls() -> None:
    pushed = np.tile([2.0, 0.0, 5.0], (10001, 1))
    offset, limited = slosh(TIMES, pushed, GRAVITY, 0.05, 0.7, 1.0)
    assert offset[-1] == pytest.approx([-2.0 * 0.05 / 9.81, 0, 0], abs=1e-9) and limited == 0
    held, limited = slosh(TIMES, pushed, GRAVITY, 0.05, 0.7, 0.005)
    assert np.linalg.norm(held, axis=1).max() == pytest.approx(0.005)
    assert limited == (np.linalg.norm(offset, axis=1) > 0.005).sum() > 0


def test_loose_body_falls_in_a_parabola_and_rests() -> None:
    r = loose(TIMES, UPRIGHT, STILL, STILL, GRAVITY, 1.0, 0.05)
    fall = math.sqrt(2 * 0.05 / 9.81)
    early = fall > TIMES
    assert r[early, 2] == pytest.approx(-9.81 * TIMES[early] ** 2 / 2, abs=1e-12)
    assert r[~early, 2] == pytest.approx(-0.05, abs=1e-12)


def test_bounces_lose_the_energy_that_restitution_says() -> None:
    r = loose(TIMES, UPRIGHT, STILL, STILL, GRAVITY, 0.3, 0.05)[:, 2] + 0.05
    peaks = [k for k in range(1, 600) if r[k] > r[k - 1] and r[k] >= r[k + 1] and r[k] > 1e-3]
    for number, k in enumerate(peaks[:3], start=1):
        assert r[k] == pytest.approx(0.05 * 0.7 ** (2 * number), abs=3e-6)
    assert r[-1] == pytest.approx(0.0, abs=1e-12)  # the endless bounces end


def test_elastic_body_keeps_its_energy_over_a_hundred_bounces() -> None:
    r = loose(TIMES, UPRIGHT, STILL, STILL, GRAVITY, 0.0, 0.02)[:, 2]
    quarter = math.sqrt(2 * 0.02 / 9.81)
    phase = (TIMES + quarter) % (2 * quarter) - quarter
    assert r == pytest.approx(-9.81 * phase**2 / 2, abs=1e-9)


def test_in_a_turning_room_a_free_body_stays_where_it_is_in_the_world() -> None:
    """Fictitious forces against the truth of an inertial frame."""
    w = 2.0
    c, s = np.cos(w * TIMES), np.sin(w * TIMES)
    turn = np.tile(np.eye(3), (10001, 1, 1))
    turn[:, 0, 0] = turn[:, 1, 1] = c
    turn[:, 1, 0], turn[:, 0, 1] = s, -s
    pull = np.array([0.5, 0.0, 0.0])
    spin = np.tile([0.0, 0.0, w], (10001, 1))
    r = loose(TIMES[:301], turn[:301], spin[:301], STILL[:301], pull, 0.0, 0.05)
    # At rest with the turning room at its centre is at rest in the world.
    assert r[:, 0] == pytest.approx(0.25 * TIMES[:301] ** 2, abs=1e-7)
    assert np.abs(r[:, 1]).max() < 1e-7


def test_one_bounce_is_exact() -> None:
    x, v = bounce(0.0, 1.0, 0.0, 1.5, 1.0, 0.5)
    assert (x, v) == pytest.approx((0.75, -0.5))
    x, v = bounce(0.0, 0.0, -2.0, 1.5, 1.0, 0.5)  # hits -1 at t = 1 with speed 2, comes back with 1
    assert (x, v) == pytest.approx((-1 + 0.5 - 0.25, 1.0 - 1.0))


def test_what_cannot_swing_is_refused() -> None:
    for call in (
        lambda: pendulum(TIMES, STILL, np.zeros(3), 0.1, 0.0),
        lambda: pendulum(TIMES, STILL, GRAVITY, 0.0, 0.0),
        lambda: slosh(TIMES, STILL, GRAVITY, 0.1, -1.0, 0.1),
        lambda: slosh(TIMES, STILL, GRAVITY, 0.1, 0.1, 0.0),
        lambda: loose(TIMES, UPRIGHT, STILL, STILL, GRAVITY, 1.5, 0.1),
    ):
        with pytest.raises(DermisError):
            call()
