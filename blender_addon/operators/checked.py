"""Base of operators that check a bake before they use it.

The scene is sampled again, and the work is refused if its inputs have changed since the bake.
"""

from __future__ import annotations

from typing import Any

import bpy

from .. import baking, jobs
from ..preferences import library
from ..results import store
from .work import Work

SHORT = 1.0  # [s] longest sampling for which a person waits without a display of progress


class Checked(jobs.Job, Work):
    """Checks bakes, then does the work.

    From a script, or if it is short, the check is done at once; otherwise between the window's events.
    """

    _asked = False  # whether a person asked for the work in a window; overrides of `invoke` set it

    def checked(self, context: bpy.types.Context) -> list[bpy.types.Scene]:
        """Return the scenes whose bakes are checked."""
        return [context.scene]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Check, then work."""
        results = [result for scene in self.checked(context) if (result := store.current(scene)) is not None]
        slow = sum(result.bake.stage_seconds.get("sampling", 0.0) for result in results) > SHORT
        watched = self._asked and slow and context.window is not None and not bpy.app.background
        return jobs.Job.invoke(self, context, None) if watched else jobs.Job.execute(self, context)

    def steps(self, context: bpy.types.Context) -> jobs.Steps:
        """Return the check."""
        for uid in [scene.session_uid for scene in self.checked(context)]:
            scene = next((s for s in bpy.data.scenes if s.session_uid == uid), None)
            if scene is not None:
                yield from baking.verified(scene, library())

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Work, and report."""
        return Work.execute(self, context)
