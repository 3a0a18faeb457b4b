"""The load of commands at a rate, and whether a link carries it: told when connecting, not by lost commands."""

from __future__ import annotations

import math

from ...errors import DermisError
from ..protocols.adapter import Adapter
from .token_bucket import TokenBucket
from .transport import Transport

SHARE = 0.8  # part of a link's capacity that commands may take: answers asked again, a safe state, a catching up [1]


def needed(adapter: Adapter, rate: float) -> float:
    """Return the most bytes a second that commands at a rate [Hz] put on the link, with all that goes beside them."""
    return max(rate, adapter.least_rate) * adapter.command_bytes + adapter.other_bytes


def bucket(adapter: Adapter, link: Transport, rate: float) -> TokenBucket:
    """Return how fast commands may leave: at their rate; to catch up, as fast as the link carries.

    A link of unknown speed is taken to carry the load that `check` would require.
    """
    need = needed(adapter, rate)
    return TokenBucket(need, max(need / SHARE, SHARE * (link.carries or 0.0)))


def ramp_period(adapter: Adapter, link: Transport, requested: float, declared: float) -> float:
    """Return the time between the commands of a ramp [s]: the preset's own, however few the stream was asked to send.

    A ramp of few commands would be a few jumps. A link that carries no more gets no more.

    Args:
        requested, declared: rates of the stream and of the preset [Hz].
    """
    fits = math.inf if link.carries is None else (SHARE * link.carries - adapter.other_bytes) / adapter.command_bytes
    return 1.0 / max(requested, min(declared, fits))


def check(adapter: Adapter, link: Transport, rate: float) -> None:
    """Refuse a link that cannot carry commands at a rate [Hz].

    Raises:
        DermisError: it cannot; says how many bytes a second are needed and carried, and which rate or link would do.
    """
    if link.carries is None or needed(adapter, rate) <= SHARE * link.carries:
        return
    faster = needed(adapter, rate) / SHARE
    fits = math.floor((SHARE * link.carries - adapter.other_bytes) / adapter.command_bytes)
    slower = f"Set Rate (--rate) to {fits} Hz, or take" if fits >= max(adapter.least_rate, 1.0) else "Take"
    raise DermisError(
        f"the link cannot carry commands at {rate:g} Hz",
        where=link.name,
        value=f"{needed(adapter, rate):,.0f} bytes a second",
        limit=f"{SHARE * link.carries:,.0f}, which is {SHARE:.0%} of the {link.carries:,.0f} that it carries",
        remedy=f"{slower} a faster link: {math.ceil(faster):,} bytes a second, "
        f"a serial port of {math.ceil(10 * faster)} baud" + (f". {adapter.faster}" if adapter.faster else ""),
    )
