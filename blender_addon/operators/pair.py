"""Pair a board with this computer over USB.

Over Wi-Fi, the board then answers this computer alone.
"""

from typing import Any

import bpy
from bpy.props import StringProperty

from .. import jobs, redraw
from .._core import core
from ..layouts import words
from ..polls import needs
from ..streaming import session

WIDTH = 440


@needs(lambda _context: not session.connected(), "Disconnect first")
class DERMIS_OT_stream_pair(jobs.Job, bpy.types.Operator):
    """Give an ESP32 on a USB port a key and the name of your Wi-Fi. It then answers this computer alone, and its
    address is written into Port. Esc cancels"""

    bl_idname = "dermis.stream_pair"
    bl_label = "Pair over USB"
    bl_options = {"INTERNAL"}  # without REGISTER: Blender would list the arguments, the password too
    job_title = "Pairing"
    after_cancel = "the board may have taken a new key already: pair it before you use it"

    port: StringProperty(  # type: ignore[valid-type]
        name="USB Port",
        description="Serial port of the board, such as /dev/ttyUSB0 or COM3",
        search=lambda _self, _context, _text: [name for name, _ in session.found_ports()],
        search_options={"SUGGESTION"},
        options={"SKIP_SAVE"},
    )
    network: StringProperty(  # type: ignore[valid-type]
        name="Wi-Fi", description="Name of the 2.4 GHz network that the board joins", options={"SKIP_SAVE"}
    )
    password: StringProperty(  # type: ignore[valid-type]
        name="Password",
        description="Password of the network; empty if it has none. The board stores it in its flash memory, Blender "
        "does not",
        subtype="PASSWORD",
        options={"SKIP_SAVE"},
    )

    _asked = False

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for port, network and password, unless a script has given the network."""
        if self.network or bpy.app.background or context.window is None:
            return super().invoke(context, event)
        session.rescan()
        ports = [name for name, _ in session.found_ports()]
        if not self.port and len(ports) == 1:
            self.port = ports[0]
        self._asked = True
        return context.window_manager.invoke_props_dialog(self, width=WIDTH, confirm_text="Pair")

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the three fields and the conditions for pairing."""
        layout = self.layout
        text = (
            "Plug the board in by USB. It needs dermis_servos, built with DERMIS_WIFI. Opening the port may reset it."
        )
        words(layout, text, WIDTH, "INFO")
        if not session.found_ports():
            words(layout, "No serial port was found. Check cable and driver, then open this again.", WIDTH, "ERROR")
        column = layout.column()
        column.use_property_split = True
        for name in ("port", "network", "password"):
            column.prop(self, name)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Pair at once; after the dialog, pair between the window's events."""
        if not self._asked:
            return super().execute(context)
        given = {"port": self.port, "network": self.network, "password": self.password}
        self.password = ""
        if not self.network:
            self.report({"ERROR"}, "No Wi-Fi is named. Enter the name of the network that the board is to join")
            return {"CANCELLED"}
        bpy.ops.dermis.stream_pair("INVOKE_DEFAULT", **given)
        return {"FINISHED"}

    def steps(self, _context: bpy.types.Context) -> jobs.Steps:
        """Return the work, which opens the port at its first step."""
        password, self.password = self.password, ""
        return core.stream.pair_command.pair_at(self.port, self.network, password)

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Choose the board in the panel."""
        settings = context.scene.dermis_stream
        settings.protocol, settings.url = "native-wifi", result.address
        self.report({"INFO"}, f"'{result.board}' answers this computer alone. Unplug USB, power it, and press Connect")
        session.read_pairs()
        redraw.request()
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (DERMIS_OT_stream_pair,)
