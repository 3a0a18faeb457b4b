"""Sound cards that may drive an amplifier, opened by python-sounddevice.

The card drives an amplifier of high voltage, or a coil on a finger. It is therefore chosen by its exact name, is opened
so that no other program can play to it, and must not be the card for the system's own sounds.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np

from ...arrays import Array
from ...errors import DermisError

VIRTUAL = "virtual:"
POLL = 0.005  # [s] time between two checks whether the card is done
# Host interfaces of PortAudio that give a card to one program alone. ALSA does so for raw hardware, '(hw:1,0)'. A card
# called 'plughw:' may resample without notice.
EXCLUSIVE = ("Windows WASAPI", "Windows WDM-KS", "ASIO", "ALSA")
ALIKE = 20  # number of compared characters in the names of one card by two host interfaces: some shorten the name

Source = Callable[[int], Array]
Sink = Callable[[Array], None]


class Card(Protocol):
    """The interface of a card that is open for this program alone.

    Attributes:
        name: name by which it was chosen. rate: sampling rate [Hz].
        dry: number of times that the card had no samples to play.
    """

    name: str
    rate: int
    dry: int

    def run(self, source: Source, done: Callable[[], bool], sink: Sink | None = None) -> None:
        """Play until done.

        Args:
            source: returns n samples from -1 to 1, shape (n,), for an n; it is called on the card's own thread.
            done: returns whether to stop. sink: takes the samples recorded meanwhile, shape (n,).

        Raises:
            DermisError: the card is gone, or runs at another rate.
        """


def names() -> tuple[str, ...]:
    """Return the names of the cards that may be chosen.

    Raises:
        DermisError: python-sounddevice is not installed.
    """
    sound = _sounddevice()
    entries = [_named(sound, entry) for entry in sound.query_devices() if entry["max_output_channels"] > 0]
    return tuple(name for name, entry in entries if not _refusal(sound, entry))


def open_card(name: str, rate: int, *, records: bool = False) -> Card:
    """Return a card.

    Args:
        name: exact name, as `names` returns it; 'virtual:' is a simulated card. rate: sampling rate [Hz].
        records: whether an input is needed, too.

    Raises:
        DermisError: python-sounddevice is not installed; there is no such card; the system plays its own sounds to it;
            other programs could play to it; or it does not support the rate, or has no input.
    """
    if name.startswith(VIRTUAL):
        from ..virtual.sound_loop import virtual_card

        return virtual_card(name, rate)
    sound = _sounddevice()
    entries = dict(_named(sound, entry) for entry in sound.query_devices() if entry["max_output_channels"] > 0)
    if name not in entries:
        raise DermisError(
            "no sound card of exactly this name",
            where="sound card",
            value=name or "none",
            limit=", ".join(entries) or "none is there",
            remedy="Choose one by its whole name",
        )
    if refusal := _refusal(sound, entries[name]):
        raise refusal
    if records and entries[name]["max_input_channels"] < 1:
        raise DermisError("the sound card has no input", where=f"sound card '{name}'", value=0, limit=">= 1 channel")
    return PortAudioCard(sound, name, entries[name], rate, records=records)


class PortAudioCard:
    """A card that PortAudio opens for this program alone; see `Card`.

    Only the first channel of the output, and of the input, is used.
    """

    def __init__(self, sound: Any, name: str, entry: Mapping[str, Any], rate: int, *, records: bool) -> None:
        self.name, self.rate, self.dry = name, rate, 0
        self._sound = sound
        own = {"device": entry["index"], "dtype": "float32"}
        if _host(sound, entry) == "Windows WASAPI":
            own["extra_settings"] = sound.WasapiSettings(exclusive=True)
        self._open = {**own, "samplerate": rate, "channels": 1, "clip_off": True, "dither_off": True, "latency": "low"}
        try:
            sound.check_output_settings(**own, samplerate=rate, channels=1)
            if records:
                sound.check_input_settings(**own, samplerate=rate, channels=1)
        except Exception as error:  # PortAudioError, and ValueError for an unknown setting
            raise DermisError(
                "the sound card cannot be opened like this",
                where=f"sound card '{name}'",
                value=f"{rate} Hz: {error}",
                remedy="Choose another rate, and end what else plays to it",
            ) from error

    def run(self, source: Source, done: Callable[[], bool], sink: Sink | None = None) -> None:
        """Play until done; see `Card`."""
        failed: list[BaseException] = []
        over = threading.Event()

        def fill(out: Any, status: Any) -> None:
            if status.output_underflow:
                self.dry += 1
            try:
                out[:, 0] = source(len(out))
            except BaseException as error:  # an exception here would make the card repeat the last buffer
                out[:] = 0.0
                failed.append(error)

        def both(coming: Any, out: Any, _count: int, _time: Any, status: Any) -> None:
            fill(out, status)
            assert sink is not None
            sink(np.array(coming[:, 0], np.float64))

        def only(out: Any, _count: int, _time: Any, status: Any) -> None:
            fill(out, status)

        more = {"finished_callback": over.set}
        try:
            stream = (
                self._sound.OutputStream(**self._open, callback=only, **more)
                if sink is None
                else self._sound.Stream(**self._open, callback=both, **more)
            )
            with stream:
                if abs(stream.samplerate / self.rate - 1.0) > 1e-4:
                    raise self._refused("the sound card runs at another rate", f"{stream.samplerate:g} Hz")
                while not done() and not failed and not over.is_set():
                    time.sleep(POLL)
        except self._sound.PortAudioError as error:
            raise self._refused("the sound card is gone, or another program uses it", str(error)) from error
        if failed:
            raise failed[0]
        if not done():
            raise self._refused("the sound card has stopped by itself", "stopped")

    def _refused(self, what: str, value: str) -> DermisError:
        return DermisError(
            what,
            where=f"sound card '{self.name}'",
            value=value,
            limit=f"{self.rate} Hz",
            remedy="Switch the amplifier off before you look for the cause",
        )


def _sounddevice() -> Any:
    if find_spec("sounddevice") is None:
        raise DermisError(
            "a sound card needs the Python package 'sounddevice', which is not installed",
            where="sound card",
            remedy="Run 'pip install sounddevice' with the Python that runs Dermis",
        )
    try:
        import sounddevice
    except OSError as error:  # PortAudio itself is missing
        raise DermisError(
            "'sounddevice' cannot load PortAudio",
            where="sound card",
            value=str(error),
            remedy="Install PortAudio, such as the package libportaudio2",
        ) from error
    return sounddevice


def _host(sound: Any, entry: Mapping[str, Any]) -> str:
    return str(sound.query_hostapis(entry["hostapi"])["name"])


def _named(sound: Any, entry: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    """Return a card's full name, as in python-sounddevice's list, and its entry."""
    return f"{entry['name']}, {_host(sound, entry)}", entry


def _refusal(sound: Any, entry: Mapping[str, Any]) -> DermisError | None:
    """Return why a card must not drive an amplifier; None if it may."""
    name, host = entry["name"], _host(sound, entry)
    where = f"sound card '{name}, {host}'"
    if host not in EXCLUSIVE or (host == "ALSA" and "(hw:" not in name):
        return DermisError(
            "other programs could play to this sound card meanwhile",
            where=where,
            value=host,
            limit="ALSA 'hw:' cards, WASAPI, WDM-KS, ASIO",
            remedy="Choose the same card by an interface that gives it to one program alone. On macOS there is none",
        )
    chosen = {api["default_output_device"] for api in sound.query_hostapis()} - {-1}
    for index in chosen:
        default = sound.query_devices(index)["name"]
        if index == entry["index"] or default[:ALIKE] == name[:ALIKE]:
            return DermisError(
                "the system plays its own sounds to this card",
                where=where,
                value=default,
                limit="a card that is not the system's default",
                remedy="Make another card the default of the system, or buy a second one for the amplifier",
                code="default-card",
            )
    return None
