"""Retraction: what a safe pose of a worn device must keep, whichever finger is in it.

The rules were set before any pose was looked at:

* CLEAR: in the safe pose the platform stands at least this far below the pad of the thickest finger among the skins
  that ship. Devices sit on the nail, so a finger thicker than the one that a preset was made for hangs lower by the
  difference.
* DEEPENING: on the way there, each channel at its own speed, the platform never presses deeper than where it started
  by more than this.
"""

from __future__ import annotations

FITTED = 13.0e-3  # [m] thickness of the finger that the platforms' presets were made for, nail to pad
THICKEST = 18.0e-3  # [m] of the skins that ship: a large thumb
CLEAR = 2.0e-3  # [m]
DEEPENING = 0.05e-3  # [m]
