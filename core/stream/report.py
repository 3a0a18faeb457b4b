"""How a streamer stands, in plain values: what the panel shows and the shared state carries."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from .source import Panel, Play

if TYPE_CHECKING:
    from .streamer import Streamer


def report(streamer: Streamer) -> dict[str, Any]:
    """Return state, message, rate, lateness, counters and what is driven, as JSON values."""
    p50, p99 = streamer.sample_clock.lateness.percentiles()
    adapter, limiter, wire = streamer.adapter, streamer.limiter, streamer.wire
    message = (
        "; ".join(filter(None, (streamer.message.rstrip("."), streamer.going))) if streamer.going else streamer.message
    )
    out: dict[str, Any] = {
        "state": streamer.state,
        "message": message,
        "armed": streamer.armed,
        "arm_id": streamer.arm_id,
        "pose_known": streamer.pose_known,
        "rate": streamer.rate,
        "jitter_p50_us": _plain(p50 * 1e6),
        "jitter_p99_us": _plain(p99 * 1e6),
        "counters": dict(streamer.counters),
        "limited": dict(limiter.limited) if limiter else {},
        "names": list(wire.names) if wire else [],
        "units": list(wire.units) if wire else [],
        "values": limiter.last.tolist() if limiter else [],
        "safe_s": _plain(wire.safe_seconds) if wire else None,
        "not_rendered": str(streamer.source.loss or "") if isinstance(streamer.source, Play) else "",
    }
    if adapter is not None:
        out |= {
            "device": adapter.device,
            "watchdog": adapter.watchdog,
            "caution": adapter.caution,
            "output_hz": adapter.output_hz,
            "notice": adapter.notice,
            "round_trip_ms": _plain(adapter.round_trip * 1e3),
            "protocol": dict(adapter.counters),
            "pose": None if adapter.pose is None else adapter.pose.tolist(),
        }
    if isinstance(streamer.source, Panel):
        out["limited"]["amplitude.law"] = streamer.source.limited
        out["counters"]["touches grown old"] = streamer.source.aged
    if streamer.link is not None:
        out |= {"link": streamer.link.name, "received": streamer.link.report()}
    return out


def _plain(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None
