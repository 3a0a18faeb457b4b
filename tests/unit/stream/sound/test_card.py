"""Which sound cards may drive an amplifier, and how they are opened.

No sound card is needed: a module stands in for python-sounddevice that has its documented calls, and is a fake.
"""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from core.errors import DermisError
from core.stream.sound import card as cards
from core.stream.sound.card import names, open_card

HOSTS = ("ALSA", "Windows WASAPI", "MME", "Core Audio", "PulseAudio")
BOARD, OWN = "USB Audio: #1 (hw:1,0)", "HDA Intel PCH: ALC256 (hw:0,0)"


class Fake(ModuleType):
    """The calls of python-sounddevice that are used, as its documentation has them."""

    class PortAudioError(Exception):
        pass

    def __init__(self) -> None:
        super().__init__("sounddevice")
        self.__spec__ = ModuleSpec("sounddevice", None)
        self.devices = [
            self.device(0, OWN, "ALSA"),
            self.device(1, BOARD, "ALSA"),
            self.device(2, "pulse", "ALSA"),
            self.device(3, "USB Audio", "Windows WASAPI"),
            self.device(4, "USB Audio", "MME"),
            self.device(5, "USB Audio", "Core Audio"),
            self.device(6, "Microphone (hw:2,0)", "ALSA", outputs=0),
            self.device(7, "Speakers (Realtek(R) Audio)", "Windows WASAPI"),
            self.device(8, "Speakers (Realtek(R) A", "MME"),
            self.device(9, "plughw:1,0", "ALSA"),
        ]
        self.defaults = {"ALSA": 0, "MME": 8}
        self.rates, self.opened, self.actual, self.blocks, self.status = [48_000], [], 0.0, 40, False
        self.fails = ""

    def device(self, index: int, name: str, host: str, outputs: int = 2) -> dict[str, Any]:
        return {
            "index": index,
            "name": name,
            "hostapi": HOSTS.index(host),
            "max_output_channels": outputs,
            "max_input_channels": 2 if index != 3 else 0,
        }

    def query_devices(self, index: int | None = None) -> Any:
        return self.devices if index is None else self.devices[index]

    def query_hostapis(self, index: int | None = None) -> Any:
        every = tuple({"name": name, "default_output_device": self.defaults.get(name, -1)} for name in HOSTS)
        return every if index is None else every[index]

    def WasapiSettings(self, exclusive: bool = False) -> Any:
        return SimpleNamespace(exclusive=exclusive)

    def check_output_settings(self, **more: Any) -> None:
        if more["samplerate"] not in self.rates:
            raise self.PortAudioError("Invalid sample rate")

    check_input_settings = check_output_settings

    def OutputStream(self, **more: Any) -> Any:
        return self.stream(more, inputs=False)

    def Stream(self, **more: Any) -> Any:
        return self.stream(more, inputs=True)

    def stream(self, more: dict[str, Any], *, inputs: bool) -> Any:
        if self.fails:
            raise self.PortAudioError(self.fails)
        self.opened.append(more)
        outer = self

        class Stream:
            samplerate = outer.actual or more["samplerate"]

            def __enter__(self) -> Any:
                self.out = []
                for _ in range(outer.blocks):
                    out = np.full((64, 1), 9.0, np.float32)
                    status = SimpleNamespace(output_underflow=outer.status)
                    coming = [np.ones((64, 1), np.float32)] if inputs else []
                    more["callback"](*coming, out, 64, None, status)
                    self.out.append(out[:, 0])
                outer.out = np.concatenate(self.out)
                return self

            def __exit__(self, *_: Any) -> None:
                more["finished_callback"]()

        return Stream()


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Fake:
    made = Fake()
    monkeypatch.setitem(sys.modules, "sounddevice", made)
    return made


def test_only_cards_for_one_program_that_are_nobodys_default_are_offered(fake: Fake) -> None:
    assert names() == (f"{BOARD}, ALSA", "USB Audio, Windows WASAPI")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("", "no sound card of exactly this name"),
        ("USB", "no sound card of exactly this name.*Choose one by its whole name"),
        ("default", "no sound card of exactly this name"),
        (f"{OWN}, ALSA", "the system plays its own sounds to this card"),
        ("plughw:1,0, ALSA", "other programs could play to this sound card"),
        ("pulse, ALSA", "other programs could play to this sound card"),
        ("USB Audio, MME", "other programs could play"),
        ("USB Audio, Core Audio", "other programs could play.*On macOS there is none"),
        ("Speakers (Realtek(R) Audio), Windows WASAPI", "the system plays its own sounds"),
        ("Microphone (hw:2,0), ALSA", "no sound card of exactly this name"),
    ],
)
def test_others_are_refused(fake: Fake, name: str, words: str) -> None:
    with pytest.raises(DermisError, match=words):
        open_card(name, 48_000)
    assert not fake.opened


def test_a_card_is_opened_alone_unclipped_and_at_its_own_rate(fake: Fake) -> None:
    with pytest.raises(DermisError, match=r"cannot be opened like this \(found '96000 Hz: Invalid sample rate'"):
        open_card(f"{BOARD}, ALSA", 96_000)
    with pytest.raises(DermisError, match="has no input"):
        open_card("USB Audio, Windows WASAPI", 48_000, records=True)
    card, sent = open_card("USB Audio, Windows WASAPI", 48_000), []
    card.run(lambda n: sent.append(n) or np.full(n, 0.5), lambda: len(sent) >= 40)
    (more,) = fake.opened
    assert more["extra_settings"].exclusive and more["clip_off"] and more["dither_off"] and more["device"] == 3
    assert (fake.out == 0.5).all() and card.dry == 0
    heard: list[Any] = []
    open_card(f"{BOARD}, ALSA", 48_000, records=True).run(np.zeros, lambda: len(heard) >= 40, heard.append)
    assert all((part == 1.0).all() for part in heard) and "extra_settings" not in fake.opened[-1]


def test_what_goes_wrong_while_it_plays_is_told_and_leaves_silence(fake: Fake) -> None:
    card = open_card(f"{BOARD}, ALSA", 48_000)

    def broken(_count: int) -> Any:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        card.run(broken, lambda: False)
    assert not fake.out.any(), "the buffer held something else before"
    fake.status = True
    card.run(np.zeros, lambda: True)
    assert card.dry == 40
    fake.actual = 44_100.0
    with pytest.raises(DermisError, match=r"runs at another rate \(found '44100 Hz'; allowed: 48000 Hz"):
        card.run(np.zeros, lambda: True)
    fake.fails = "Device unavailable"
    with pytest.raises(DermisError, match="is gone, or another program uses it.*Switch the amplifier off"):
        card.run(np.zeros, lambda: True)


def test_without_the_package_or_portaudio_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cards, "find_spec", lambda _name: None)
    for call in (names, lambda: open_card("x", 48_000)):
        with pytest.raises(DermisError, match="pip install sounddevice"):
            call()
