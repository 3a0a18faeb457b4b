"""Stroke over a bump that only a depth map holds: a friction screen's voltage rises uphill, and is off downhill."""

from __future__ import annotations

import dermis
import numpy as np

WIDTH, HEIGHT = 0.20, 0.10  # of the screen [m]
SIGMA, TOP = 15e-3, 3e-3  # of the bump in its middle [m]


def main() -> dict[str, list[float]]:
    """Return along the stroke where the finger is [m], the friction asked for (0 to 100) and the amplitude [V]."""
    x, y = np.meshgrid(np.linspace(-WIDTH / 2, WIDTH / 2, 400), np.linspace(-HEIGHT / 2, HEIGHT / 2, 200))
    bump = (TOP * np.exp(-(x**2 + y**2) / (2 * SIGMA**2))).astype(np.float32)
    screen = dermis.Screen("Panel", (WIDTH, HEIGHT), bump, height_unit=1.0)  # a unit of the map is a metre

    finger = dermis.Finger("Index", (dermis.DeviceUse("electrovibration", screen="Panel"),))
    way = np.stack([np.linspace(-0.08, 0.08, 241), np.zeros(241), np.zeros(241)], axis=1)
    bake = dermis.run(dermis.scene_from_poses(240.0, [(finger, way)], screens=[(screen, (0.0, 0.0, 0.0))]))

    output = bake.outputs[0]
    volts = output.track.column("amplitude")
    place = output.signals["x"]
    print(f"{output.track}: {volts.max():.0f} V at x = {1e3 * place[volts.argmax()]:.1f} mm, 0 V beyond the top")
    return {"x": place.tolist(), "friction": output.signals["friction"].tolist(), "volts": volts.tolist()}


if __name__ == "__main__":
    main()
