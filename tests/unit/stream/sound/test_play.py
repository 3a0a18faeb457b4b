"""A track through a simulated sound card: every sample, silence behind it, and what must not be played."""

from __future__ import annotations

import io
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.__main__ import main
from core.errors import DermisError
from core.presets import Library
from core.stream.signals import Signals
from core.stream.sound import play as sound_play
from core.stream.sound.measured_card import MeasuredCard
from core.stream.sound.play import FADE, SILENCE, play, samples_of
from core.stream.virtual.sound_loop import SoundLoop
from core.track import export
from core.track.command_track import CommandTrack

CHAIN = ["--wav-full-scale", "1.5", "--wav-gain", "2"]
CARD = MeasuredCard("virtual:", 48_000, 0.8, 0.012, 1e-5, 2.0, 1.0)
ROOT = Path(__file__).resolve().parents[4]
COIL, SCREEN = Library().device("voice_coil"), Library().device("electrovibration")


def coil_track(volts: float = 2.0, onset: float = 0.1) -> CommandTrack:
    t = np.arange(4001) / 8000.0
    wave = np.where(t > onset, volts * np.sin(2 * np.pi * 250.0 * (t - onset)), 0.0)
    return CommandTrack(COIL, t, np.column_stack([np.zeros(4001), wave]))


def screen_track(carrier: float, volts: float = 200.0) -> CommandTrack:
    return CommandTrack(SCREEN, np.arange(501) / 1000.0, np.tile([volts, carrier], (501, 1)))


def through(card: SoundLoop, samples: np.ndarray) -> np.ndarray:
    """Play samples and return what came in."""
    heard: list[np.ndarray] = []
    blocks = iter(np.pad(samples, (0, -len(samples) % 256)).reshape(-1, 256))
    left = [len(samples)]

    def source(count: int) -> np.ndarray:
        left[0] -= count
        return next(blocks)

    card.run(source, lambda: left[0] <= 0, heard.append)
    return np.concatenate(heard)


def test_every_sample_is_played_once_and_then_silence() -> None:
    samples, wave = samples_of(coil_track(), {}, CARD, "virtual:")
    assert np.abs(samples).max() == pytest.approx(2.0 / 3.0, rel=2e-3) and wave.limit == 3.0
    card = SoundLoop("virtual:", 48_000, {})
    assert play(card, samples, Signals()) == len(samples)
    assert np.array_equal(card.played[: len(samples)], samples)
    behind = card.played[len(samples) :]
    assert len(behind) >= SILENCE * 48_000 and not behind.any()


def test_amplitude_and_onset_come_out_of_the_loop() -> None:
    """What comes in again, by the loop's gain: within 0.5 %, and onsets within a millisecond of each other."""
    late = []
    for onset in np.random.default_rng(3).uniform(0.1, 0.2, 12):
        samples, _ = samples_of(coil_track(2.0, onset), {}, CARD, "virtual:")
        card = SoundLoop("virtual:", 48_000, {"noise": 0.0})
        came = through(card, np.pad(samples, (0, 4800))) * 3.0 / 0.8
        at = np.arange(len(came)) / 48_000
        steady = (at > 0.3) & (at < 0.46)
        amplitude = 2.0 * abs(np.mean(came[steady] * np.exp(-2j * np.pi * 250.0 * at[steady])))
        assert amplitude == pytest.approx(2.0, rel=5e-3)
        late.append(at[np.argmax(np.abs(came) > 0.2)] - onset)
    assert np.ptp(late) <= 1e-3 and np.mean(late) == pytest.approx(0.012, abs=1e-3)


def test_the_track_of_the_cards_page_can_be_played(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its lines write two seconds without a finding, no louder than the page says."""
    page = (ROOT / "presets" / "boards" / "sound_card.md").read_text("utf-8")
    (script,) = re.findall(r"```python\n(.*?)```", page, re.S)
    monkeypatch.chdir(tmp_path)
    exec(script.replace("import dermis", "import core as dermis"), {})
    track = export.read("tone.csv")
    assert not track.check() and track.duration == pytest.approx(2.0, abs=1e-3)
    samples, wave = samples_of(track, {"full_scale": 1.4, "gain": 10.0}, CARD, "virtual:")
    assert np.abs(wave.volts).max() == pytest.approx(0.3, rel=5e-3)
    assert np.abs(samples).max() == pytest.approx(0.3 / 14.0, rel=5e-3)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_fades_within_five_milliseconds_and_silence_follows(number: int) -> None:
    samples, _ = samples_of(coil_track(onset=0.0), {}, CARD, "virtual:")
    signals, blocks = Signals(), 0

    class Stopped(SoundLoop):
        def run(self, source: Any, done: Any, sink: Any = None) -> None:
            def counted(count: int) -> np.ndarray:
                nonlocal blocks
                blocks += 1
                if blocks == 20:
                    signals.number = number
                return source(count)

            super().run(counted, done, sink)

    card = Stopped("virtual:", 48_000, {})
    played = play(card, samples, signals)
    begun = 19 * 256
    assert played == begun + round(FADE * 48_000) < len(samples)
    assert np.array_equal(card.played[:begun], samples[:begun])
    assert np.abs(np.diff(card.played)).max() <= 1.05 * np.abs(np.diff(samples)).max(), "no knock"
    assert not card.played[played:].any() and len(card.played) >= played + SILENCE * 48_000


@pytest.mark.parametrize(
    ("track", "settings", "card", "words"),
    [
        (coil_track(), {}, replace(CARD, name="other"), "card or rate differ from the measured ones"),
        (coil_track(), {"rate": 96_000}, CARD, "card or rate differ.*Measure it with 'stream loopback'"),
        (coil_track(), {"offset": 0.5}, CARD, "blocks a constant voltage"),
        (coil_track(), {}, replace(CARD, corner=6.0), r"lowest frequencies.*found '50 Hz'; allowed: >= 59"),
        (screen_track(60.0), {}, replace(CARD, corner=10.0), "lowest frequencies.*found '60 Hz'.*Raise the carrier"),
        (screen_track(200.0), {"carrier": 60.0}, replace(CARD, corner=10.0), "lowest frequencies.*'60 Hz'"),
        (coil_track(2.9), {}, replace(CARD, loudest=0.9), "louder than the card plays without distortion"),
        (coil_track(), {"full_scale": 1.0}, CARD, "beyond full scale"),
    ],
)
def test_what_the_card_cannot_play_is_refused(track: Any, settings: Any, card: MeasuredCard, words: str) -> None:
    with pytest.raises(DermisError, match=words):
        samples_of(track, settings, card, "virtual:")


def test_a_screen_without_voltage_needs_no_frequency_and_higher_carriers_pass() -> None:
    samples, wave = samples_of(screen_track(200.0), {}, replace(CARD, corner=10.0), "virtual:")
    assert samples.any() and {f.code for f in wave.findings} == {"open-loop"}
    assert not samples_of(screen_track(10.0, 0.0), {}, CARD, "virtual:")[0].any()


def test_the_verb_plays_tells_and_refuses(tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    track, card = tmp_path / "t.csv", tmp_path / "card.json"
    export.write(coil_track(), track, "csv")
    CARD.save(card)
    line = ["stream", "sound", str(track), "--card", "virtual:", "--measured", str(card), *CHAIN]
    assert main([*line, "--yes"]) == 0
    assert "played 0.50 of 0.50 s, dry 0" in capsys.readouterr().out
    replace(CARD, corner=30.0).save(card)
    assert main([*line, "--yes"]) == 2 and "lowest frequencies" in capsys.readouterr().err
    CARD.save(card)
    played: list[int] = []
    monkeypatch.setattr(sound_play, "play", lambda *_: played.append(1) or 0)
    monkeypatch.setattr("sys.stdin", io.StringIO())  # nobody is there to press Enter
    assert main(line) == 2 and not played and "was not confirmed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([], "'no --wav-full-scale, no --wav-gain'"),
        (CHAIN[:2], "found 'no --wav-gain'.*Measure and give: --wav-gain"),
        (CHAIN[2:], "found 'no --wav-full-scale'.*RMS volts of a full-scale tone"),
        ([*CHAIN[2:], "--wav-full-scale", "0"], "found 'no --wav-full-scale'"),
    ],
)
def test_a_chain_that_is_not_stated_is_refused(given: list[str], words: str, tmp_path: Path, capsys: Any) -> None:
    """A card of 1.4 V and an amplifier of 10 gave 2.8 V where 0.6 V were announced."""
    track, card = tmp_path / "t.csv", tmp_path / "card.json"
    export.write(coil_track(), track, "csv")
    CARD.save(card)
    line = ["stream", "sound", str(track), "--card", "virtual:", "--measured", str(card), *given, "--yes"]
    assert main(line) == 2
    said = capsys.readouterr()
    assert "voltage at the device is not known" in said.err and re.search(words, said.err) and not said.out


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP"])
def test_a_signal_to_the_program_ends_it_by_silence(name: str, tmp_path: Path) -> None:
    """A program of its own, a card at a real one's pace: it does not sleep or die with a voltage on."""
    number = getattr(signal, name)
    track, card = tmp_path / "t.csv", tmp_path / "card.json"
    long = coil_track(onset=0.0)
    whole = np.tile(long.values[:4000], (40, 1))  # 20 s
    export.write(replace(long, times=np.arange(len(whole)) / 8000.0, values=whole), track, "csv")
    slow = "virtual:?pace=1"
    replace(CARD, name=slow).save(card)
    line = [sys.executable, "-m", "core", "stream", "sound", str(track), "--card", slow, "--measured", str(card)]
    line += CHAIN
    # Enter is pressed here, so the test knows that the card is about to play
    child = subprocess.Popen(line, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert child.stdin is not None and child.stdout is not None
    try:
        assert "gets up to 2 V" in child.stdout.readline()
        child.stdin.write("\n")
        child.stdin.flush()
        time.sleep(0.5)
        child.send_signal(number)
        out, _ = child.communicate(timeout=30)
    finally:
        child.kill()
    assert child.returncode == 128 + number
    played = float(re.search(r"played ([\d.]+) of 20", out)[1])  # type: ignore[index]
    assert 0.1 < played < 15.0


def test_a_card_that_ran_dry_is_told(tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    track, card = tmp_path / "t.csv", tmp_path / "card.json"
    export.write(coil_track(), track, "csv")
    CARD.save(card)
    dry = SoundLoop("virtual:", 48_000, {})
    dry.dry = 3
    monkeypatch.setattr(sound_play, "open_card", lambda *_: dry)
    assert main(["stream", "sound", str(track), "--card", "virtual:", "--measured", str(card), *CHAIN, "--yes"]) == 1
    assert "nothing to play for a moment" in capsys.readouterr().err


def test_a_card_that_is_gone_ends_it() -> None:
    samples, _ = samples_of(coil_track(), {}, CARD, "virtual:")
    with pytest.raises(DermisError, match="the sound card is gone"):
        play(SoundLoop("virtual:", 48_000, {"gone": 3000.0}), samples, Signals())
