"""The load of commands on a link, and the check of the link's capacity.

The check is made at Connect, before any command is lost.
"""

from __future__ import annotations

import math

from ...errors import DermisError
from ..protocols.adapter import Adapter
from .token_bucket import TokenBucket
from .transport import Transport

# [1] part of a link's capacity that commands may take. The rest is for repeated questions, the safe state, and a sender
# that catches up.
SHARE = 0.8


def needed(adapter: Adapter, rate: float) -> float:
    """Return the largest load of commands at a rate [Hz], in bytes/s.

    The traffic beside commands is included.
    """
    return max(rate, adapter.least_rate) * adapter.command_bytes + adapter.other_bytes


def bucket(adapter: Adapter, link: Transport, rate: float) -> TokenBucket:
    """Return the bucket that limits the bytes of commands.

    It fills at the load of the commands at their rate. To catch up, it fills as fast as the link carries. A link of
    unknown capacity is assumed to carry the load that `check` would require.
    """
    need = needed(adapter, rate)
    return TokenBucket(need, max(need / SHARE, SHARE * (link.carries or 0.0)))


def ramp_period(adapter: Adapter, link: Transport, requested: float, declared: float) -> float:
    """Return the time between the commands of a ramp [s].

    A ramp has at least the preset's rate, even if the stream has a lower one: with few commands it would be a few
    jumps. The preset's rate is reduced to the rate that the link carries, but not below that of the stream.

    Args:
        requested, declared: rates of the stream and of the preset [Hz].
    """
    fits = math.inf if link.carries is None else (SHARE * link.carries - adapter.other_bytes) / adapter.command_bytes
    return 1.0 / max(requested, min(declared, fits))


def check(adapter: Adapter, link: Transport, rate: float) -> None:
    """Refuse a link that cannot carry commands at a rate [Hz].

    Raises:
        DermisError: the load exceeds `SHARE` of the capacity. The error states both, and a rate or link that suffices.
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
