"""How well a calibrated actuator reaches what is wanted, on a bent curve with play that was measured up and down."""

from __future__ import annotations

from dataclasses import replace

from . import Result, benchmark

NAME = "calibration_inverse_error"
PLAYS = (0.0, 0.01, 0.04, 0.15)  # of a range of 2
SEEDS = 4


@benchmark(NAME, limit=1e-3, quick=True)
def inverse_error() -> Result:
    """Measure the largest error of what is reached, of the range, over ways with reversals, pauses and steps.

    Peers: the middle of both curves alone, without the play; and no curve at all.
    """
    from tests.bent_actuator import Actuator, commands, measured, worst_error

    errors, middles, plain = [], [], []
    for play in PLAYS:
        for seed in range(SEEDS):
            actuator = Actuator(play)
            curve = measured(actuator)
            low, high = curve.reach
            wanted = commands(seed, 0.97 * low, 0.97 * high)
            errors.append(worst_error(actuator, curve, wanted))
            grid = [point[0] for point in curve.rising if curve.falling[0][0] <= point[0] <= curve.falling[-1][0]]
            middle = tuple((d, curve.between(d)) for d in grid)
            middles.append(worst_error(actuator, replace(curve, rising=middle, falling=middle), 0.9 * wanted))
            plain.append(max(abs(actuator.drive(float(v)) - v) for v in wanted) / (high - low))
    peers = {"middle curve": max(middles), "no curve": max(plain)}
    return Result(NAME, max(errors), "of range", peers=peers)
