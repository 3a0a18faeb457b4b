"""The state of a link, in a word for people.

Senders report it, and panels show it.
"""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """The state of a link.

    A link goes from DISCONNECTED to CONNECTING, READY, ARMED and, while samples move the device, STREAMING.

    On the way to the safe state it is STOPPING, and READY after that. If Blender gave no sign of life or the sender was
    silent, it is STALLED both times, until somebody arms again. After an error FAULT replaces all of these states,
    until the next attempt to connect, or until the link is closed and no longer requested.
    """

    DISCONNECTED = "disconnected"
    CONNECTING = "connecting"
    READY = "ready"
    ARMED = "armed"
    STREAMING = "streaming"
    STOPPING = "stopping"
    STALLED = "stalled"
    FAULT = "fault"
    DEAD = "dead"  # the process that held the link has ended by itself; the process that started it reports that


WAITING = (State.READY, State.STALLED)  # a device is there, and can be armed
OVER = (State.DISCONNECTED, State.FAULT, State.DEAD)  # nothing is armed, and nothing will be by itself
