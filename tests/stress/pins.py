"""Pins: bounded least squares however ill-conditioned, with corners of the bounds, warm along a track."""

from __future__ import annotations

import numpy as np

from core.errors import DermisError
from core.matching.bounded_lsq import BoundedLeastSquares

from . import tolerances
from .case import Dice, Family, Values, Verdict, bits_of


def draw(dice: Dice) -> Values:
    """Draw a problem's size, condition, bounds and how its right-hand side moves."""
    return {
        "count": dice.one_of(1, 2, 5, 16, 64, 128),
        "condition": dice.decades(1.0, 1e18),
        "rank": dice.between(0.2, 1.0),
        "size": dice.decades(1e-6, 1e6),
        "span": dice.decades(1e-4, 1e2),
        "shut": dice.some(0.3, dice.between(0.0, 1.0)),
        "load": dice.decades(1e-3, 1e3),
        "drift": dice.decades(1e-4, 10.0),
        "alike": dice.some(0.2, dice.whole(1, 8), 0),
        "random": dice.whole(0, 10**6),
    }


def judge(values: Values) -> Verdict:
    """Solve along a short track."""
    rng, n = np.random.default_rng(int(values["random"])), int(values["count"])
    turn = np.linalg.qr(rng.normal(size=(n, n)))[0]
    spectrum = float(values["condition"]) ** -np.linspace(0.0, 1.0, n)
    spectrum[max(int(np.ceil(n * float(values["rank"]))), 1) :] = 0.0
    gram = (turn * spectrum) @ turn.T
    for k in range(min(int(values["alike"]), n - 1)):  # pins that do the same
        gram[k + 1], gram[:, k + 1] = gram[0], gram[:, 0]
        gram[k + 1, k + 1] = gram[0, 0]
    gram = float(values["size"]) * (gram + gram.T) / 2
    if int(values["alike"]):  # rows made alike one by one need not be of one matrix: take the nearest that is
        low, turn = np.linalg.eigh(gram)
        gram = (turn * np.maximum(low, 0.0)) @ turn.T
        gram = (gram + gram.T) / 2
    low = np.where(rng.uniform(size=n) < 0.5, 0.0, -rng.uniform(size=n) * float(values["span"]))
    high = low + float(values["span"]) * np.where(rng.uniform(size=n) < float(values["shut"]), 0.0, rng.uniform(size=n))
    verdict = Verdict(excuses={"kkt": frozenset({"not-converged"})})
    try:
        solver = BoundedLeastSquares(gram, low, high)
    except DermisError as refusal:
        # a matrix of rounding may have an eigenvalue below zero: only that may be refused
        lowest = float(np.linalg.eigvalsh(gram)[0]) / max(float(np.abs(gram).max()), 1e-300)
        verdict.hold("refused rightly", not (lowest < 0.0 and "definite" in str(refusal)), 0)
        return verdict
    c = float(values["load"]) * float(values["size"]) * float(values["span"]) * rng.normal(size=n)
    for _ in range(4):
        found = solver.solve(c)
        verdict.hold("finite", int((~np.isfinite(found.x)).sum()), 0)
        beyond = max(float((low - found.x).max()), float((found.x - high).max()))
        verdict.hold("bounds", max(beyond, 0.0), tolerances.BEYOND)
        exact = found._replace(gradient=gram @ found.x - c)
        verdict.hold("kkt", exact.optimality(low, high), tolerances.KKT)
        if not found.converged:
            verdict.told |= {"not-converged"}
        c = c + float(values["drift"]) * np.abs(c).max() * rng.normal(size=n)
    again = [BoundedLeastSquares(gram, low, high).solve(c).x for _ in range(2)]
    verdict.hold("same bits", bits_of(again[:1]) != bits_of(again[1:]), tolerances.BITS)
    return verdict


FAMILIES = (
    Family(
        "pins",
        "bounded least squares, ill-conditioned and in corners",
        draw,
        judge,
        {"alike": 0, "shut": 0.0, "rank": 1.0, "condition": 1.0, "size": 1.0, "load": 1.0},
    ),
)
