"""`python -m core thimble`: recordings become tracks that check, plots are pictures, nonsense is refused in words."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest

from core.__main__ import main
from core.devices.disc_pose import FrictionState, placed
from core.devices.thimble import mechanism
from core.files import write_npz
from core.presets import Library
from core.scene import scene_file
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, TactileScene
from core.skin.model import fingertip_skin, skin_from_parameters
from core.skin.sensor import electrode_sensor
from core.surrogate.store import contact_of
from core.surrogate.table import SampleTable
from core.track import csv
from tests.tables import write_table

FOLLOW = ("follow", "--device", "thimble_3rrs")


@pytest.fixture(scope="module")
def device():
    return mechanism(Library().device("thimble_3rrs"))


@pytest.fixture(scope="module")
def recorded(device):
    """Readings of the virtual sensor while the device itself presses and tilts: times, poses, channels."""
    skin = skin_from_parameters(Library().skin("index_medium"), level="draft")
    sensor, contact = electrode_sensor(skin), contact_of(device, skin, 0.6)
    times = np.arange(61) / 100.0
    depth = 0.9e-3 * np.sin(np.pi * np.clip(times / 0.6, 0, 1)) - 0.1e-3
    x = np.stack([0.15 * np.sin(6 * times), 0.12 * np.sin(5 * times), 0.018 - depth], axis=1)
    state, out = FrictionState.rest(contact.count), []
    for pose in x:
        contact.hold(state)
        found = contact.solve(placed(device, device.pose(pose)))
        state = contact.settle(found) if found.touching else FrictionState.rest(contact.count)
        out.append(sensor.matrix @ contact.nodal(found).ravel())
    return times, x, np.array(out)


def test_a_recorded_sequence_becomes_a_track(tmp_path, recorded, capsys):
    times, x, channels = recorded
    rows = [",".join(f"{v:.9g}" for v in [t, *c]) for t, c in zip(times, channels, strict=True)]
    (tmp_path / "felt.csv").write_text("time," + ",".join(f"e{i}" for i in range(19)) + "\n" + "\n".join(rows))
    out = tmp_path / "track.csv"
    assert main([*FOLLOW, str(tmp_path / "felt.csv"), "--out", str(out)]) == 0
    assert "median mismatch" in capsys.readouterr().out
    track = csv.read(out)
    pressed = np.abs(channels).max(axis=1) > 0.2 * np.abs(channels).max()
    assert pressed.sum() > 20
    # what the device made is given back as the device's own way
    assert np.median(np.abs(np.degrees(track.column("pitch") - x[:, 0]))[pressed]) < 1.5
    assert np.median(np.abs(track.column("distance") - x[:, 2])[pressed]) < 0.1e-3
    assert main(["check", str(out)]) == 0


def test_noise_of_an_untouched_sensor_is_no_touch(tmp_path, recorded, capsys):
    """Rest, one press, rest: the device waits still, follows, and waits again."""
    rng, (_, _, channels) = np.random.default_rng(2), recorded
    rest = np.zeros((60, channels.shape[1]))
    readings = np.concatenate([rest, channels, rest])
    sigma = 0.004 * np.abs(channels).max()
    write_npz(
        tmp_path / "felt.npz",
        {"times": np.arange(len(readings)) / 100.0, "stimuli": readings + rng.normal(0.0, sigma, readings.shape)},
    )
    arguments = [*FOLLOW, str(tmp_path / "felt.npz"), "--out", str(tmp_path / "t.csv")]
    assert main(arguments) == 0
    track = csv.read(tmp_path / "t.csv")
    servos = np.degrees(np.stack([track.column(f"servo_{i}") for i in (1, 2, 3)], axis=1))
    assert np.ptp(servos[:58], axis=0).max() == 0.0 and np.ptp(servos[-40:], axis=0).max() == 0.0
    assert np.ptp(servos[60:120], axis=0).max() > 3.0
    assert 30 < int(capsys.readouterr().out.split(" touched")[0].split()[-1]) < 62
    # who says that there is no noise has all of it followed
    assert main([*arguments, "--noise", "0"]) == 0
    assert f"{len(readings)} touched" in capsys.readouterr().out
    assert main([*arguments, "--noise", "-1"]) == 2


def test_findings_are_told(tmp_path, recorded, capsys):
    """A press within two samples is faster than the servos: that is said, and the track still keeps the limits."""
    _, _, channels = recorded
    strong = channels[np.abs(channels).max(axis=1).argmax()]
    readings = np.concatenate([np.zeros((20, len(strong))), np.tile(6 * strong, (20, 1)), np.zeros((20, len(strong)))])
    write_npz(tmp_path / "felt.npz", {"times": np.arange(60) / 100.0, "stimuli": readings})
    assert main([*FOLLOW, str(tmp_path / "felt.npz"), "--out", str(tmp_path / "t.csv")]) == 0
    assert "speed holds the match back" in capsys.readouterr().err
    assert main(["check", str(tmp_path / "t.csv")]) == 0


def test_a_recorded_table_takes_the_place_of_the_model(tmp_path, recorded, device):
    times, x, channels = recorded
    touched = np.abs(channels).max(axis=1) > 0
    write_table(
        tmp_path / "table.npz",
        SampleTable(x[touched], np.zeros((touched.sum(), 0)), channels[touched], np.arange(touched.sum()) // 5),
    )
    write_npz(tmp_path / "felt.npz", {"times": times, "stimuli": channels})
    arguments = [*FOLLOW, str(tmp_path / "felt.npz"), "--out", str(tmp_path / "t.csv")]
    assert main([*arguments, "--table", str(tmp_path / "table.npz")]) == 0
    assert csv.read(tmp_path / "t.csv").meta["method"] == "electrodes"
    write_table(tmp_path / "other.npz", SampleTable(x, np.zeros((len(x), 0)), channels[:, :7], np.zeros(len(x), int)))
    assert main([*arguments, "--table", str(tmp_path / "other.npz")]) == 2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t, s: (t, s[:, :5]), "the expected shape"),
        (lambda t, s: (t, np.where(np.arange(len(t))[:, None] == 7, np.nan, s)), "not finite.*row 8|row 8.*not finite"),
        (lambda t, s: (t[::-1], s), "times do not rise"),
    ],
)
def test_recordings_that_are_none_are_refused(tmp_path, recorded, capsys, change, words):
    times, stimuli = change(recorded[0], recorded[2])
    write_npz(tmp_path / "felt.npz", {"times": times, "stimuli": stimuli})
    assert main([*FOLLOW, str(tmp_path / "felt.npz"), "--out", str(tmp_path / "t.csv")]) == 2
    assert __import__("re").search(words, capsys.readouterr().err) and not (tmp_path / "t.csv").exists()


def test_a_damaged_recording_and_a_foreign_device_are_refused(tmp_path, capsys):
    (tmp_path / "felt.npz").write_bytes(b"PK nothing")
    assert main([*FOLLOW, str(tmp_path / "felt.npz"), "--out", str(tmp_path / "t.csv")]) == 2
    assert "cannot be read" in capsys.readouterr().err
    assert main(["thimble", "reach", "--device", "haptip"]) == 2
    assert "not a thimble" in capsys.readouterr().err


def test_the_reach_is_told(capsys, device):
    assert main(["thimble", "reach"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "40 deg" in lines[0] and len(lines) == 11
    distance, smallest, largest = map(float, lines[5].split())
    assert 0 < smallest <= largest
    tilt = np.radians(smallest) * 0.999
    assert all(device.feasible((tilt * np.cos(a), tilt * np.sin(a), 1e-3 * distance)) for a in np.arange(0, 6.3, 0.3))


def test_the_reach_is_that_of_the_channels(tmp_path, capsys):
    """A servo whose channel ends earlier ends the level platform's way too, where its crank is at that angle."""
    import json

    own = json.loads(json.dumps(dict(Library().device("thimble_3rrs").source)))
    own["channels"][1]["high"] = {"value": 15, "unit": "deg", "source": "stop"}
    own["safe"]["values"]["servo_2"]["value"] = 15
    (tmp_path / "devices").mkdir()
    (tmp_path / "devices" / "mine.json").write_text(json.dumps(own))
    assert main(["thimble", "reach", "--presets", str(tmp_path), "--device", "mine"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "-40 to 40, -40 to 15, -40 to 40 deg" in lines[0]
    device = mechanism(Library(tmp_path).device("mine"))
    ends = []
    for turn in (-40.0, 15.0):
        q = device.servo_zero + np.radians(turn)
        across = device.platform_radius - device.base_radius - device.crank * np.cos(q)
        ends.append(device.crank * np.sin(q) + np.sqrt(device.rod**2 - across**2))
    told, margin = [float(line.split()[0]) for line in lines[2:]], 0.02 * (ends[1] - ends[0])
    assert told[0] == pytest.approx(1e3 * (ends[0] + margin), abs=0.01)
    assert told[-1] == pytest.approx(1e3 * (ends[1] - margin), abs=0.01)


def test_links_that_cannot_close_are_refused_by_name(tmp_path, capsys):
    import json

    preset = Library().load("devices", "thimble_3rrs")
    for name, value, words in (("rod", 5, "links cannot close"), ("crank", -1, "'crank' must be above zero")):
        own = json.loads(json.dumps(preset))
        own["parameters"][name]["value"] = value
        (tmp_path / "devices").mkdir(exist_ok=True)
        (tmp_path / "devices" / "mine.json").write_text(json.dumps(own))
        assert main(["thimble", "reach", "--device", "mine", "--presets", str(tmp_path)]) == 2
        assert words in capsys.readouterr().err


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("touching", [True, False])
def test_the_plot_of_a_sampled_scene(tmp_path, capsys, touching):
    fingertip_skin(level="draft")
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.05
    plate = Mesh(square, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    times = np.arange(7) / 12.0
    fingers = np.tile(np.eye(4), (1, 7, 1, 1))
    fingers[0, :, 2, 3] = 2e-3 - (2.8e-3 * np.sin(np.pi * times / times[-1]) if touching else 0.0)
    bodies = np.tile(np.eye(4), (1, 7, 1, 1))
    use = DeviceUse("thimble_3rrs", {"thimble_method": "stress"})
    finger = Finger("index", (use,), {"skin": Library().skin("index_medium"), "skin_level": "draft"})
    chunk = Chunk(times * 12, times, fingers, bodies, fingers[:0])
    scene = TactileScene("s", Fraction(12), (0, 6), 12.0, (finger,), (Body("plate", plate, {}),), (), (chunk,))
    scene_file.save(scene, tmp_path / "scene.npz")
    arguments = ["thimble", "plot", str(tmp_path / "scene.npz"), "--out"]
    floor = ["floor", str(tmp_path / "scene.npz"), "--quiet", "--out", str(tmp_path / "floor.json")]
    if not touching:
        for words in ([*arguments, str(tmp_path / "p.png")], floor):
            assert main(words) == 2
            assert "touches nothing" in capsys.readouterr().err
        return
    assert main(floor) == 0
    told, said = json.loads((tmp_path / "floor.json").read_text()), capsys.readouterr().out
    assert 0.0 < told["with_lateral_axes"]["whole stress"] <= told["best_found"]["whole stress"] <= 1.0
    assert told["best_found"]["whole stress"] <= told["rendered"]["whole stress"] and told["device"] == "thimble_3rrs"
    assert "best pose found" in said and f"{100 * told['best_found']['electrodes']:.1f} %" in said
    assert main([*floor, "--device", "hexapod"]) == 0
    legs = json.loads((tmp_path / "floor.json").read_text())
    assert legs["with_lateral_axes"] is None and legs["method"] == "stress"
    assert main([*floor, "--device", "haptip"]) == 2 and "whose pose is searched" in capsys.readouterr().err
    assert main([*floor, "--finger", "3"]) == 2
    assert main([*arguments, str(tmp_path / "p.png")]) == 0
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    assert main([*arguments, str(tmp_path / "p.svg")]) == 0
    text = (tmp_path / "p.svg").read_text()
    assert text.count("<polyline") == 9 and "rendered" in text and text.count("<circle") > 3000
    assert main([*arguments, str(tmp_path / "q.png"), "--finger", "3"]) == 2
