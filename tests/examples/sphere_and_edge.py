"""Press a ball and an edge into a fingertip: what each asks of the skin at the same depth."""

from __future__ import annotations

import dermis
import numpy as np


def main() -> dict[str, dict[str, list[float]]]:
    """Return, by surface and for each depth, the force [N], the peak pressure [Pa], and the contact's size [m]."""
    skin = dermis.fingertip(level="standard")
    surfaces = {"ball": dermis.Surface.sphere(5e-3, facets=5_000), "edge": dermis.Surface.edge(np.pi / 2)}
    depths = [0.4e-3, 0.8e-3, 1.2e-3]
    told: dict[str, dict[str, list[float]]] = {}
    for name, surface in surfaces.items():
        touches = [dermis.press(skin, surface, depth, friction=0.5) for depth in depths]
        told[name] = {
            "force": [touch.normal_force for touch in touches],
            "pressure": [float(touch.pressure.max()) for touch in touches],
            "across": [extent(touch, 0) for touch in touches],  # X: across the finger
            "along": [extent(touch, 1) for touch in touches],  # Y: along the finger, and along the edge
        }
        for depth, touch in zip(depths, touches, strict=True):
            print(f"{name}, {1e3 * depth:.1f} mm: {touch.normal_force:.2f} N, {touch.von_mises.max() / 1e3:.1f} kPa")
    return told


def extent(touch: dermis.Touch, axis: int) -> float:
    """Return how far the pressure spreads about its middle along an axis: its standard deviation [m]."""
    push = np.maximum(touch.pressure * touch.skin.areas, 0.0)
    offset = touch.skin.positions[:, axis] - touch.centre_of_pressure[axis]
    return float(np.sqrt(push @ offset**2 / push.sum()))


if __name__ == "__main__":
    main()
