"""Operators of the live link: connect, arm, stop.

Actions that may hurt a person or write a file ask first.
"""

import bpy
from bpy.props import BoolProperty, StringProperty

from .._core import core
from ..layouts import words
from ..streaming import agreed_paths, board_identity, frame_hold, session, stream_log
from .checked import Checked
from .work import Work, counted


class Streaming(Work):
    """Work on the live link."""

    bl_options = {"INTERNAL"}
    subject = "Streaming"


class DERMIS_OT_stream_connect(Streaming, bpy.types.Operator):
    """Connect to the device. Nothing moves before you arm it"""

    bl_idname = "dermis.stream_connect"
    bl_label = "Connect"

    confirmed: BoolProperty(  # type: ignore[valid-type]
        name="Confirmed",
        description="Reading and writing the files that this .blend file names is allowed",
        options={"HIDDEN", "SKIP_SAVE"},
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask about files that came with the .blend."""
        if not agreed_paths.pending(context.scene.dermis_stream):
            return self.execute(context)
        self.confirmed = True  # by the dialog's button
        return context.window_manager.invoke_props_dialog(
            self,
            width=560,
            title="Files Named by This .blend",
            confirm_text="Use Them and Connect",
            cancel_default=True,
        )

    def draw(self, context: bpy.types.Context) -> None:
        """Name each file and its use."""
        layout = self.layout
        words(layout, "You did not choose these files: they came with the .blend. Go on only if you know them.", 640)
        for claim in agreed_paths.pending(context.scene.dermis_stream):
            box = layout.box()
            box.alert = claim.kind == "write"
            words(box, f"{claim.kind.capitalize()}: {claim.what}", 560, "ERROR" if claim.kind == "write" else "FILE")
            words(box, claim.path, 560, "BLANK1")

    def work(self, context: bpy.types.Context) -> str | None:
        """Start the sender."""
        if self.confirmed:
            agreed_paths.confirm(agreed_paths.pending(context.scene.dermis_stream))
        session.connect(context.scene)
        return board_identity.advice(context.scene) or None


class DERMIS_OT_stream_disconnect(Streaming, bpy.types.Operator):
    """Bring the device to its safe state and close the connection"""

    bl_idname = "dermis.stream_disconnect"
    bl_label = "Disconnect"

    def work(self, context: bpy.types.Context) -> str | None:
        """End the sender, which still completes a ramp to the safe state."""
        session.close()
        return core.stream.client.leaving() or None


class DERMIS_OT_stream_arm(Checked, Streaming, bpy.types.Operator):
    """Enable the device's motors. It starts at its current pose. Locate the Stop button first. An outdated bake is not
    played"""

    bl_idname = "dermis.stream_arm"
    bl_label = "Arm"
    job_title = "Arm"

    fingers_out: BoolProperty(  # type: ignore[valid-type]
        name="Fingers Out", description="No finger is in the device", options={"HIDDEN", "SKIP_SAVE"}
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask to take the finger out if the first pulse may cause a jump."""
        self._asked = True
        if not (session.connected() and session.pose_unknown()):
            return self.execute(context)
        self.fingers_out = True  # by the dialog's button
        return context.window_manager.invoke_props_dialog(
            self, width=440, title="Take the Finger Out", confirm_text="Arm", cancel_default=True
        )

    def draw(self, context: bpy.types.Context) -> None:
        """Warn of dangers, and of missing abilities of the board."""
        box = self.layout.box()
        box.alert = True
        words(
            box,
            "This device does not know where its motors are. The first pulse may jump at full speed. "
            "Take the finger out, then press Arm.",
            440,
            "ERROR",
        )
        caution, silence = session.caution(context.scene), session.silence()
        for text in (caution, silence if silence[1:-1] not in caution else ""):
            if text:
                words(self.layout.box(), text, 440, "INFO")

    def checked(self, context: bpy.types.Context) -> list[bpy.types.Scene]:
        """Return the scene if its bake is to be played.

        The list is empty while something steps through the frames, because arming is refused then.
        """
        plays = session.plays_bake(context.scene) and not frame_hold.held()
        return [context.scene] if plays else []

    def work(self, context: bpy.types.Context) -> str | None:
        """Arm once."""
        session.arm(context.scene, fingers_out=self.fingers_out)
        return None


class DERMIS_OT_stream_stop(bpy.types.Operator):
    """Bring the device to its safe state now"""

    bl_idname = "dermis.stream_stop"
    bl_label = "Stop"
    bl_options = {"INTERNAL"}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Stop; if nothing is connected, pass the key on."""
        if not session.connected():
            return {"PASS_THROUGH"}
        session.stop()
        self.report({"WARNING"}, "Stopped: the device goes to its safe state")
        return {"FINISHED"}


class DERMIS_OT_stream_logs(Streaming, bpy.types.Operator):
    """Open the folder of the logs"""

    bl_idname = "dermis.stream_logs"
    bl_label = "Show Logs"

    def work(self, context: bpy.types.Context) -> str | None:
        """Open the folder, if there is one yet."""
        folder = core.files.check_folder(stream_log.folder(context.scene.dermis_stream))
        bpy.ops.wm.path_open(filepath=str(folder))
        return None


class DERMIS_OT_stream_rescan(Streaming, bpy.types.Operator):
    """Look for serial ports, and for boards that were paired with this computer"""

    bl_idname = "dermis.stream_rescan"
    bl_label = "Rescan Ports"

    def work(self, context: bpy.types.Context) -> str | None:
        """Search for ports and boards, and report their numbers."""
        ports = session.rescan()
        session.read_pairs()
        return f"{counted(ports, 'serial port')}, {counted(len(session.paired_boards()), 'paired board')}"


class DERMIS_OT_stream_use_port(Streaming, bpy.types.Operator):
    """Use this port, and the protocol of a paired board"""

    bl_idname = "dermis.stream_use_port"
    bl_label = "Use Port"

    port: StringProperty(name="Port", description="Address of the serial port")  # type: ignore[valid-type]

    def work(self, context: bpy.types.Context) -> str | None:
        """Write it into the field."""
        settings = context.scene.dermis_stream
        settings.url = self.port
        if self.port in session.paired_boards().values():
            settings.protocol = "native-wifi"
        return None


CLASSES: tuple[type, ...] = (
    DERMIS_OT_stream_connect,
    DERMIS_OT_stream_disconnect,
    DERMIS_OT_stream_arm,
    DERMIS_OT_stream_stop,
    DERMIS_OT_stream_logs,
    DERMIS_OT_stream_rescan,
    DERMIS_OT_stream_use_port,
)
