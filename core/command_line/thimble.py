"""`python -m core thimble plot | reach`, and `follow` with a thimble.

`follow` here is that with a learned model. `follow.py` has the look-up, also for thimbles.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ..contact.skin_contact import SkinContact
from ..contact.skin_sampler import skin_contacts
from ..devices.spec import DeviceSpec
from ..devices.thimble import Thimble, mechanism, reference_distance
from ..devices.workspace import workspace
from ..errors import DermisError, Finding
from ..matching.recorded import RecordedMatcher, check_recording, learn
from ..matching.stimulus_plot import stimulus_plot
from ..matching.stress import StressMatcher
from ..matching.thimble import amounts_at, findings_of, forces_at, match_stimuli, match_touch, matcher
from ..matching.thimble_use import ThimbleUse, calibrated_mechanism, prepare
from ..parameters.skin import DEFAULT_SKIN
from ..plot import stimuli as plot_stimuli
from ..presets import Library
from ..scene import scene_file
from ..scene.tactile_scene import TactileScene, sample_count
from ..skin.finger_skin import asked_for, finger_skin
from ..skin.model import SkinModel, skin_from_parameters
from ..skin.sensor import electrode_sensor, noise_floor_of, noise_of, read_stimuli
from ..surrogate.store import contact_of
from ..surrogate.table import read_table
from ..track import csv
from ..track.command_track import CommandTrack


def follow(options: argparse.Namespace) -> int:
    """Write a track that renders recorded readings; return the exit status."""
    if options.noise is not None and not 0.0 <= options.noise < float("inf"):
        raise DermisError("noise is a standard deviation", where="--noise", value=options.noise, limit=">= 0")
    library = Library(options.presets)
    spec = _thimble(library, options.device)
    skin = asked_for(skin_from_parameters(library.skin(options.skin), level=options.level), options.tissue, "--tissue")
    device, friction = calibrated_mechanism(spec, skin, {})
    change = device.servo_speed / spec.rate
    made = (
        _virtual(skin, device, friction, change)
        if options.table is None
        else _recorded(options.table, skin, device, friction, change)
    )
    channels = made.model.size
    recorded, stimuli = read_stimuli(options.stimuli, channels)
    noise = noise_of(stimuli) if options.noise is None else options.noise
    made.noise_floor = noise_floor_of(noise, channels)
    times = np.arange(int(np.floor((recorded[-1] - recorded[0]) * spec.rate + 1e-9)) + 1) / spec.rate
    wanted = np.stack([np.interp(times, recorded - recorded[0], column) for column in stimuli.T], axis=1)
    found = match_stimuli(made, wanted)
    track = CommandTrack(
        spec, times, found.commands(spec), {"method": "electrodes", "stimuli": options.stimuli.name}
    ).within_limits()
    csv.write(track, options.out)
    for finding in (*findings_of(found, str(options.stimuli)), *_beyond(made, str(options.stimuli)), *track.check()):
        print(finding, file=sys.stderr)
    touched = found.touched
    off = float(np.median(found.mismatch[touched])) if touched.any() else 0.0
    print(
        f"{options.out}: {len(times)} samples, {int(touched.sum())} touched, median mismatch {100 * off:.1f} %; "
        f"noise {noise:.3g} a channel, readings up to {made.noise_floor:.3g} are no touch"
    )
    return 0


def _virtual(skin: SkinModel, device: Thimble, friction: float, change: float) -> StressMatcher:
    """Return a matcher of readings of the virtual electrodes.

    Args:
        skin: model of the skin.
        device: the thimble.
        friction: coefficient of friction between the thimble's disc and the skin.
        change: largest change of a servo's angle from sample to sample [rad].
    """
    return matcher(device, skin, friction=friction, observation_matrix=electrode_sensor(skin).matrix, change=change)


def _recorded(path: Path, skin: SkinModel, device: Thimble, friction: float, change: float) -> StressMatcher:
    """Return a matcher of readings of the sensor of a recorded table.

    A model is learned from the table. Its error and the findings are printed.

    Args:
        path: file of the table.
        skin, device, friction, change: as in `_virtual`.
    """
    table = read_table(path).without_memory()
    check_recording(table, device, str(path))
    contact = contact_of(device, skin, friction)
    learned = learn(table, device, contact)
    if np.isfinite(learned.error):
        print(
            f"{path}: {len(table.x)} rows, {table.channels.shape[1]} channels, {learned.runs} runs; on runs held out "
            f"the model, with {learned.table.memory.shape[1]} components of depth, is {100 * learned.error:.1f} % off"
        )
    for finding in learned.findings(str(path)):
        print(finding, file=sys.stderr)
    return RecordedMatcher(device, contact, learned.model, table, change=change)


def _beyond(made: StressMatcher, where: str) -> list[Finding]:
    """Return the finding on best poses outside the recorded ones, or none."""
    outside: int = getattr(made, "outside", 0)
    if not outside:
        return []
    what = f"in {outside} samples the best pose is beyond the recorded ones, and was held at their edge"
    return [
        Finding("warning", "outside-recording", what, where, remedy="Record steeper and deeper poses", count=outside)
    ]


def plot(options: argparse.Namespace) -> int:
    """Draw the stimuli of a scene's finger in three principal components.

    Return the exit status.
    """
    scene, library = scene_file.load(options.scene), Library(options.presets)
    if not 0 <= options.finger < len(scene.fingers):
        raise DermisError(
            "no such finger", where=str(options.scene), value=options.finger, limit=f"0 to {len(scene.fingers) - 1}"
        )
    finger = scene.fingers[options.finger]
    worn = next((u for u in finger.devices if library.device(u.preset).kind == "thimble"), None)
    spec = _thimble(library, options.device if worn is None else worn.preset)
    felt = _felt(scene, library, options.finger)
    use: ThimbleUse = prepare(spec, felt.pressed, {} if worn is None else worn.parameters)
    for finding in use.findings:
        print(finding, file=sys.stderr)
    times = np.arange(sample_count(scene.fps, scene.frame_range, spec.rate)) / spec.rate
    forces = forces_at(felt, times)
    if not forces.any():
        raise DermisError("the finger touches nothing", where=f"finger '{finger.name}'")
    amounts = amounts_at(felt, times)
    found = match_touch(use, forces, use.device.servo_speed / spec.rate, amounts)
    made = stimulus_plot(use, forces, found, amounts=amounts)
    print(plot_stimuli.write(options.out, *picture(made, found, finger.name)))
    return 0


def picture(made: Any, found: Any, finger: str) -> tuple[Any, ...]:
    """Return the picture of a stimulus plot.

    The picture is the arguments of `plot.stimuli.write` after the path.

    Args:
        made: the plot, see `stimulus_plot`.
        found: the matched sequence.
        finger: name of the finger.
    """
    lines = {"target": made.target, "predicted": made.predicted, "rendered": made.rendered}
    touched = found.touched
    off, whole = (float(np.median(e[touched])) if touched.any() else 0.0 for e in (found.mismatch, found.stress_error))
    words = (
        f"simulated; method {found.method}; median mismatch {100 * off:.0f} %, of the whole stress {100 * whole:.0f} %;"
        f" three components leave "
        f"{100 * made.left:.0f} % of what the device can make felt"
    )
    kept = {name: line for name, line in lines.items() if line is not None}
    return made.cloud, made.configuration, kept, f"{finger}: stress in three principal components", words


def reach(options: argparse.Namespace) -> int:
    """Print the platform's tilt limits by distance; return the exit status."""
    spec = _thimble(Library(options.presets), options.device)
    device = mechanism(spec)
    found = workspace(device, reference_distance(spec, device))
    low, high = (np.degrees(end) for end in device.servo_limits)
    alike = np.ptp(low) == np.ptp(high) == 0.0 and -low[0] == high[0]
    ends = (
        f"{high[0]:.3g} deg"
        if alike
        else ", ".join(f"{a:.3g} to {b:.3g}" for a, b in zip(low, high, strict=True)) + " deg"
    )
    print(f"{spec.name}: servos within {ends}")
    print("distance [mm]   smallest tilt limit [deg]   largest")
    for distance, tilt in zip(found.distance, np.degrees(found.tilt), strict=True):
        print(f"{1e3 * distance:13.2f}   {tilt.min():25.1f}   {tilt.max():7.1f}")
    return 0


def _thimble(library: Library, key: str) -> DeviceSpec:
    spec = library.device(key)
    if spec.kind != "thimble":
        raise DermisError("not a thimble", where=f"device preset '{key}'", value=spec.kind)
    return spec


def _felt(scene: TactileScene, library: Library, finger: int) -> SkinContact:
    skin = finger_skin(scene.fingers[finger].parameters, library.skin(DEFAULT_SKIN))
    return skin_contacts(scene, {finger: skin})[finger]
