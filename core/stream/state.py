"""The state of a link, in a word for people: senders report it, and panels show it."""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """A link goes from DISCONNECTED to CONNECTING, READY, ARMED and, while samples move the device, STREAMING.

    On the way to the safe state it is STOPPING, and READY after it; or STALLED both times, if Blender gave no sign of
    life: until somebody arms again. FAULT stands for all of them while something refuses, until it connects anew.
    """

    DISCONNECTED = "disconnected"
    CONNECTING = "connecting"
    READY = "ready"
    ARMED = "armed"
    STREAMING = "streaming"
    STOPPING = "stopping"
    STALLED = "stalled"
    FAULT = "fault"
    DEAD = "dead"  # the process that held the link has ended by itself: who started it says so


WAITING = (State.READY, State.STALLED)  # a device is there, and can be armed
OVER = (State.DISCONNECTED, State.FAULT, State.DEAD)  # nothing is driven, and nothing will be by itself
