"""Messages about a Pololu Maestro's error register and serial time-out."""

from __future__ import annotations

from dataclasses import dataclass

from .silence import Does, Silence

# Bits of the error register, from 0 on: name, and remedy. Source: User's Guide, section 4.b
ERRORS = (
    ("serial signal error", "Check cable and baud rate"),
    ("serial overrun", "Lower Rate"),
    ("serial buffer full", "Lower Rate"),
    ("CRC error", "The line damages commands: check cable and ground"),
    ("protocol error", "The line damages commands, or 'Enable CRC' of the board differs from crc= of the address"),
    ("serial timeout", "The board heard nothing for its Timeout: check cable and the computer's load"),
    ("script stack error", "Stop the board's script, or correct it"),
    ("script call stack error", "Stop the board's script, or correct it"),
    ("script program counter error", "Stop the board's script, or correct it"),
)
MISREAD = 1 << 3 | 1 << 4  # bits for a message that the board could not read: CRC error and protocol error
TIMEOUT = 1 << 5  # bit of the serial time-out
SETTINGS = "In Maestro Control Center, tab 'Serial Settings'"
APPLY = "press 'Apply Settings' and connect again"
GONE = "the board answers no more. Check cable and supply"
TWO = "more was answered than asked. Give each board on the line its own device number, and stop other programs on it"
RUBBISH = "the answer is none of a Maestro. Check protocol, baud rate and cable"


@dataclass(frozen=True)
class Found:
    """Result of the check of the serial time-out.

    Attributes:
        fault: why the board is refused, in words. caution: a warning; '' for none.
    """

    fault: str = ""
    caution: str = ""


def names(errors: int) -> list[str]:
    """Return the names of the errors in an error register."""
    return [name for bit, (name, _) in enumerate(ERRORS) if errors >> bit & 1]


def went_home(errors: int) -> str:
    """Return the message about errors of an armed board, with their remedies."""
    remedies = dict.fromkeys(remedy for bit, (_, remedy) in enumerate(ERRORS) if errors >> bit & 1)
    return (
        f"the board reports {', '.join(names(errors))}, and has sent its servos to their 'On startup or error' "
        f"positions. {'. '.join(remedies)}"
    )


def other_crc(crc: bool) -> str:
    """Return the message that the board requires, or refuses, a CRC.

    `crc`: whether the address sets one.
    """
    if crc:
        return f"the board answers commands without a CRC only. {SETTINGS}, tick 'Enable CRC', {APPLY}; or use crc=0"
    there = SETTINGS[0].lower() + SETTINGS[1:]
    return f"the board expects a CRC. Add crc=1 to the address; or {there}, untick 'Enable CRC' and {APPLY}"


def misread(errors: int, crc: bool) -> str:
    """Return the message that the board could not read a question."""
    if crc and not errors & 1 << 3:
        return f"the board takes the CRC for an error. {SETTINGS}, tick 'Enable CRC', {APPLY}; or use crc=0"
    return f"the board reports {', '.join(names(errors))} while nothing but questions is sent. Check cable and ground"


def no_answer(device: int | None, crc: bool) -> str:
    """Return the message that no board answers, with or without a CRC."""
    who = "no board answers" if device is None else f"no board with the device number {device} answers"
    number = "" if device is None else f", 'Device Number' {device}"
    tick = "tick" if crc else "untick"
    return (
        f"{who}, with a CRC or without. Connect to the board's Command Port. "
        f"{SETTINGS}, choose 'USB Dual Port'{number}, {tick} 'Enable CRC' and {APPLY}. "
        "For a line without a way back use reads=0"
    )


def timeout(
    silence: Silence, errors: int, quiet: float, positions: list[int], safe: list[int] | None, *, whole: bool
) -> Found:
    """Check a board's serial time-out by its errors after a silence.

    Args:
        silence: behaviour declared in the address. errors: error register after the silence.
        quiet: longest possible duration of the silence, questions and answers included [s].
        positions: pulses after the silence [us / 4]. safe: pulses of the safe state [us / 4], None if the board is not
            declared to go there. whole: whether the silence lasted as long as the declared one.
    """
    noticed = f"it noticed a silence of at most {1e3 * quiet:.0f} ms"
    set_it = f"{SETTINGS}, set 'Timeout' to {silence.after:.2f} s, {APPLY}"
    declare = f"silence=retracts&silence_ms={1e3 * silence.after:.0f}"
    if not errors & TIMEOUT:
        if not whole:
            how = f"Connect does not wait {silence.after:g} s for the board's serial timeout, so it was not checked"
            return Found(caution=f"{how}. {SETTINGS}, look whether 'Timeout' is {silence.after:.2f} s")
        bare = f"the board's serial timeout is not set, or longer than {1e3 * silence.after:.0f} ms"
        if silence.watched:
            return Found(f"{bare}, but the address declares that {silence}. {set_it}")
        return Found(
            caution=f"{bare[0].upper()}{bare[1:]}: it keeps its pulses when the computer falls silent. {set_it}"
        )
    if silence.does is Does.KEEPS:
        return Found(
            f"the address declares that {silence}, but the board's serial timeout is set: {noticed}. "
            f"Use {declare} where 'On startup or error' is 'Go to' the safe pose, else take silence= out of the address"
        )
    if safe is None:
        return Found(
            caution=f"The board's serial timeout is set: {noticed}. It does not tell what its servos do then. "
            f"{declare} in the address declares that 'On startup or error' is 'Go to' the safe pose"
        )
    goto = "In Maestro Control Center, tab 'Channel Settings', set 'On startup or error' to 'Go to'"
    if not all(positions):
        off = ", ".join(f"{k}" for k, at in enumerate(positions) if not at)
        return Found(
            f"the address declares that {silence}, but after its serial timeout the board gives no pulses on actuator "
            f"{off} of the preset. {goto} {', '.join(f'{at / 4:g}' for at in safe)} us, {APPLY}"
        )
    away = [k for k, at in enumerate(positions) if abs(at - safe[k]) > 4]  # the setting has steps of 1 us or less
    if away:
        k = away[0]
        return Found(
            caution=f"After its serial timeout the board gives {positions[k] / 4:g} us on actuator {k} of the preset, "
            f"and the safe pose is {safe[k] / 4:g} us. {goto} the safe pose, unless 'Speed' is still on the way"
        )
    return Found(
        caution=f"The board's serial timeout is set: {noticed}; its pulses are those of the safe pose. "
        "'Ignore' instead of 'Go to' would look the same here: try it before a finger goes in."
    )
