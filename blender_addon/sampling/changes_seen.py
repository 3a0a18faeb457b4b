"""Track the objects that Blender evaluates anew from frame to frame.

Other objects need not be read again.
"""

from __future__ import annotations

from collections.abc import Iterator, Set
from contextlib import contextmanager
from typing import Any

import bpy

from . import script_changes


class ChangesSeen:
    """Watcher that notes which objects change.

    While it is not watching, any object may have changed.

    Args:
        always: session uids of objects whose changes count in every query.
    """

    def __init__(self, always: Set[int] = frozenset()) -> None:
        self._always = always
        self._watching = False
        self._all = True
        self._uids: set[int] = set()

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Watch the updates of the dependency graph inside the context."""
        lists = (bpy.app.handlers.frame_change_post, bpy.app.handlers.depsgraph_update_post)
        handler = self._note  # the same bound method for adding and removing
        for handlers in lists:
            handlers.append(handler)
        self._watching, self._all = True, True
        try:
            yield
        finally:
            self._watching = False
            for handlers in lists:
                if handler in handlers:
                    handlers.remove(handler)

    def any_of(self, uids: Set[int]) -> bool:
        """Return whether any of the objects may have changed since the last call.

        Objects are given by session uid. With scripts the result is always True: Blender evaluates their changes after
        a frame again, but reports no update of them.
        """
        seen = not (self._uids.isdisjoint(uids) and self._uids.isdisjoint(self._always))
        changed = seen or self._all or not self._watching or script_changes.run_here()
        self._all = False
        self._uids.clear()
        return changed

    def _note(self, _scene: bpy.types.Scene, depsgraph: Any = None) -> None:
        if depsgraph is None:
            self._all = True
            return
        for update in depsgraph.updates:
            if isinstance(update.id, bpy.types.Object):
                self._uids.add(update.id.original.session_uid)
