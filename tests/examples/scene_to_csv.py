"""Render a scene from a file to a CSV track, and read that back: what a render farm does, and a device's program."""

from __future__ import annotations

import tempfile
from pathlib import Path

import dermis
import numpy as np


def main() -> dict[str, object]:
    """Return what the file holds, and the largest difference to what was rendered."""
    with tempfile.TemporaryDirectory() as folder:
        dermis.save_scene(tap(), Path(folder) / "tap.npz")  # as `blender --command dermis sample` does

        bake = dermis.run(dermis.load_scene(Path(folder) / "tap.npz"))
        for path in dermis.export(bake, Path(folder)):
            print(path.name, f"{path.stat().st_size / 1e3:.0f} kB")
        track = dermis.read_csv(path)

    rendered = bake.outputs[0].track
    for finding in track.check():
        print(finding)
    return {
        "file": path.name,
        "errors": [finding.code for finding in track.check() if finding.severity == "error"],
        "channels": [f"{channel.name} [{channel.unit}]" for channel in track.channels],
        "duration": track.duration,
        "off": float(np.abs(track.values - rendered.values).max()),
        "first_moved": float(track.times[np.flatnonzero(track.column("tactor_y"))[0]]),
        "same_hash": track.spec.hash == rendered.spec.hash,
    }


def tap() -> dermis.TactileScene:
    """Return a finger that comes down onto a table at 0.2 m/s, from 20 mm above: it arrives after 0.1 s."""
    time = np.arange(0.0, 0.3, 1.0 / 240.0)
    height = np.maximum(20e-3 - 0.2 * time, -1e-3)
    finger = dermis.Finger("Index", (dermis.DeviceUse("haptip"),))
    table = dermis.Body("Table", dermis.Surface.block().mesh, dermis.Library().material("wood"))
    way = np.stack([0.0 * time, 0.0 * time, height], axis=1)
    return dermis.scene_from_poses(240.0, [(finger, way)], [(table, (0.0, 0.0, 0.0))], name="tap")


if __name__ == "__main__":
    main()
