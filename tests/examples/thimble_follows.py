"""Let a thimble follow a plate that comes, tilts and goes: servo angles over time, as fast as its servos are."""

from __future__ import annotations

import dermis
import numpy as np

RATE = 100.0  # of the samples [Hz]


def main() -> dict[str, list[float]]:
    """Return, over time, how deep the plate is [m], the thimble's force [N] and its fastest servo [rad/s]."""
    time = np.arange(0.0, 1.2, 1.0 / RATE)
    depth = 1.0e-3 - 1.5e-3 * np.abs(time / 0.6 - 1.0)  # from half a millimetre away to a millimetre deep, and back
    tilt = np.radians(8.0) * np.sin(2 * np.pi * time / 1.2)  # about X: towards the tip and back
    plate = np.tile(np.eye(4), (len(time), 1, 1))
    plate[:, 1, 1], plate[:, 1, 2], plate[:, 2, 1], plate[:, 2, 2] = cos_sin(tilt)
    plate[:, 2, 3] = depth

    # "stress" matches what the skin feels, not the force alone, and takes longer to prepare
    thimble = dermis.DeviceUse("thimble_3rrs", {"thimble_method": "force"})
    finger = dermis.Finger("Index", (thimble,), {"skin_level": "draft"})
    body = dermis.Body("Plate", dermis.Surface.block().mesh, {"friction": 0.6})
    bake = dermis.run(dermis.scene_from_poses(RATE, [(finger, (0.0, 0.0, 0.0))], [(body, plate)]))

    output = bake.outputs[0]
    servos = np.stack([output.track.column(f"servo_{i}") for i in (1, 2, 3)], axis=1)
    speed = np.abs(np.diff(servos, axis=0)).max(axis=1) * output.track.spec.rate
    print(f"{output.track}\n{1e3 * depth.max():.1f} mm deep, {output.signals['normal_force'].max():.2f} N")
    for finding in bake.all_findings:
        print(finding)
    return {
        "time": time.tolist(),
        "depth": depth.tolist(),
        "track_time": output.track.times.tolist(),
        "rendered": output.signals["normal_force"].tolist(),
        "wanted": output.signals["target_force"].tolist(),
        "speed": speed.tolist(),
        "speed_limit": [
            channel.slew for channel in output.track.channels if channel.name == "servo_1" and channel.slew
        ],
    }


def cos_sin(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the four entries of a rotation in a plane."""
    return np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)


if __name__ == "__main__":
    main()
