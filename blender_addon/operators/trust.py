"""Trust Band: forces and commands that change much if the scene hardly does."""

from typing import Any

import bpy

from .. import jobs, redraw, reporting
from ..comparison import trust_steps
from ..polls import needs
from ..results import store


@needs(
    lambda context: context.mode in ("OBJECT", "POSE") and store.current(context.scene) is not None,
    "Bake first, and leave edit mode",
)
class DERMIS_OT_trust_band(jobs.Job, bpy.types.Operator):
    """Bake the scene again: shifted by 0.1 um, at twice the sample rate, and mirrored. Mark where forces or commands
    change by more than 5 % of their peak. Takes about five times as long as a bake. Esc cancels"""

    bl_idname = "dermis.trust_band"
    bl_label = "Trust Band"
    bl_options = {"REGISTER"}
    job_title = "Trust band"

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the work."""
        return trust_steps.find(context.scene)

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Report values that cannot be trusted."""
        worst = max((float(band.share.max()) for band in result.bands), default=0.0)
        done = f"Forces and commands change by {worst:.2%} of their peak at most."
        reporting.report_findings(self, result.findings, f"Trust band of {context.scene.name}", done)
        redraw.request()
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (DERMIS_OT_trust_band,)
