"""Let 128 pins feel like a ball, by every method; compare what is left of the difference; write what pins play."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import dermis
import numpy as np

METHODS = ("DM0", "DM1", "DM2", "FM0", "FM1", "FM2")  # by displacement and by force: free, clamped, bounded


def main() -> dict[str, dict[str, float]]:
    """Return, by method, the root mean square error of the skin's displacement [m] and the pins' forces [N]."""
    touch = dermis.press(dermis.fingertip(level="draft"), dermis.Surface.sphere(5e-3), depth=1e-3, friction=0.5)
    free = touch.skin.mesh.free  # the nodes that neither bone nor nail holds
    told = {}
    for method in METHODS:
        pins = dermis.match(touch, device="pin_array_128", method=method)
        off = (pins.rendered.displacement - touch.displacement)[free]
        forces = np.array(list(pins.commands.values()))
        told[method] = {
            "off": float(np.sqrt((off**2).sum(axis=1).mean())),
            "least": float(forces.min()),
            "most": float(forces.max()),
            "sum": float(forces.sum()),
            "optimality": pins.optimality,
            "limit": pins.device.channels[0].high or np.inf,
        }
        print(f"{method}: {1e6 * told[method]['off']:.0f} um off, pins from {forces.min():.3f} to {forces.max():.3f} N")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "ball.csv"
        dermis.write_csv(pins.track(duration=1.0), path)  # for `python -m core stream play ball.csv ...`
        played = dermis.read_csv(path)
    told["track"] = {"seconds": played.duration, "off": float(np.abs(played.values - pins.values).max())}
    told["touch"] = {"normal_force": touch.normal_force}
    return told


if __name__ == "__main__":
    main()
