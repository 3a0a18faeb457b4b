"""Stroke a grating at two speeds: the HapTip's cap vibrates at speed over period."""

from __future__ import annotations

import dermis
import numpy as np

PERIOD = 2e-3  # of the grating, along X [m]


def main() -> dict[str, float]:
    """Return the strongest frequency of the cap [Hz] by the speed of the stroke [m/s]."""
    return {f"{speed:g}": strongest(stroke(speed)) for speed in (0.04, 0.08)}


def stroke(speed: float) -> dermis.CommandTrack:
    """Return the HapTip's track for a second's stroke along X."""
    x = speed * (np.arange(0.0, 1.0, 1.0 / 240.0) - 0.5)
    finger = dermis.Finger("Index", (dermis.DeviceUse("haptip"),))
    material = {
        "friction": 0.6,
        "texture_on": True,
        "texture_amplitude_x": 0.1,
        "texture_period_x": PERIOD,
        "transient_on": False,
        "weight_on": False,
        "content_on": False,
    }
    grating = dermis.Body("Grating", dermis.Surface.block(width=0.2).mesh, material)
    way = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
    bake = dermis.run(dermis.scene_from_poses(240.0, [(finger, way)], [(grating, (0.0, 0.0, 0.0))]))
    return bake.outputs[0].track


def strongest(track: dermis.CommandTrack) -> float:
    """Return the frequency with the largest amplitude in the cap's movement along X [Hz]."""
    values = track.column("tactor_x")
    spectrum = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values))))
    found = float(np.fft.rfftfreq(len(values), 1.0 / track.spec.rate)[spectrum.argmax()])
    print(f"{track}: {found:.1f} Hz, {1e3 * np.abs(values).max():.3f} mm")
    return found


if __name__ == "__main__":
    main()
