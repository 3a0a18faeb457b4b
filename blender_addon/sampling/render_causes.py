"""Why renders show felt objects otherwise: settings of their own, and those of what they get their shape from."""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from . import dependence, participants, render_settings, script_changes
from .participants import Participants


class RenderCauses:
    """Follows the settings that differ, from frame to frame.

    Attributes:
        vary: they may change within the range: something animates them, or scripts run.
    """

    def __init__(self, swept: Participants, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
        self._scene, self._view_layer = scene, view_layer
        screens = participants.look_up({e.uid for e in swept.screens}).values()
        meshes = {screen.dermis.screen.mesh_object for screen in screens} - {None}
        self._own = {e.uid for e in swept.bodies if e.instance is None}  # felt where they are themselves
        self._instanced = {e.uid for e in swept.bodies if e.instance is not None} - self._own
        self._felt = self._own | self._instanced | {mesh.session_uid for mesh in meshes}
        makers = {e.instance.instancer for e in swept.bodies if e.instance is not None}
        self._makers = makers - self._felt  # of instances that are felt, and are not felt themselves
        self._varying = {o.session_uid for o in bpy.data.objects if render_settings.animated(o)}
        self._all_vary = script_changes.run_here() or render_settings.simplify_animated(scene)
        self.vary = self._all_vary or bool(self._varying)
        self._looked = False
        self._settings: dict[int, list[str]] = {}  # what differs, by session uid
        self._visibility: dict[int, list[str]] = {}  # of objects and collections
        self._reached: dict[tuple[int, bool], frozenset[int]] = {}  # who gets its shape from one

    def look(self, objects: Mapping[int, bpy.types.Object]) -> None:
        """Compare the settings of now; all of them the first time, then those that may have changed."""
        every = self._all_vary or not self._looked
        for uid in objects if every else self._varying & objects.keys():
            self._settings[uid] = render_settings.settings(objects[uid], self._scene)
            self._visibility[uid] = render_settings.visibility(objects[uid])
        for collection in bpy.data.collections if every else ():
            self._visibility[collection.session_uid] = render_settings.visibility(collection)
        if not self._looked:
            self._find_makers(objects)
        self._looked = True

    def there(self, objects: Mapping[int, bpy.types.Object]) -> set[int]:
        """Return the session uids of felt objects, and of the makers of felt instances, that are enabled now."""
        return {uid for uid in self._felt | self._makers if uid in objects and not self._is_disabled(objects[uid])}

    def hidden(self, objects: Mapping[int, bpy.types.Object]) -> set[int]:
        """Return the session uids of felt objects that renders do not show now."""
        out = {u for u in (self._felt - self._instanced) & objects.keys() if self._is_hidden(objects[u])}
        apart = {uid: objects[uid] for uid in self._instanced & objects.keys() if self._visibility.get(uid)}
        return out | {uid for uid, users in self._reach(apart, shown=True).items() if users & self._makers}

    def differing(self, objects: Mapping[int, bpy.types.Object]) -> dict[int, list[str]]:
        """Return in words what differs now, by the session uids of felt objects and of makers of felt instances."""
        out: dict[int, list[str]] = {}
        for uid in (self._felt | self._makers) & objects.keys():
            itself = render_settings.instancer(objects[uid]) if uid in self._felt else []
            out[uid] = self._settings.get(uid, []) + itself
        known = {**objects, **{c.session_uid: c for c in bpy.data.collections}}
        for words, shown, glue in ((self._settings, False, ": "), (self._visibility, True, " ")):
            sources = {uid: known[uid] for uid, said in words.items() if said and uid in known}
            for uid, users in self._reach(sources, shown=shown).items():
                for user in out.keys() & users:
                    if user in self._felt or uid not in self._felt:  # else it is told of what is felt
                        out[user] += [f"{sources[uid].name_full}{glue}{said}" for said in words[uid]]
        return {uid: said for uid, said in out.items() if said}

    def _find_makers(self, objects: Mapping[int, bpy.types.Object]) -> None:
        """Add those that would show instances of what is felt in renders only."""
        others = {uid for uid, said in self._settings.items() if said and uid not in self._felt}
        others = {uid for uid in others if objects[uid].is_instancer or len(objects[uid].particle_systems)}
        if others:
            shapes = dependence.Shapes()
            self._makers |= others & {u for uid in self._felt & objects.keys() for u in shapes.of(objects[uid])}

    def _is_disabled(self, obj: bpy.types.Object) -> bool:
        return obj.session_uid in self._own and participants.is_disabled(obj, self._view_layer)

    def _is_hidden(self, obj: bpy.types.Object) -> bool:
        return render_settings.hidden_in_renders(obj, self._view_layer)

    def _reach(self, sources: Mapping[int, bpy.types.ID], *, shown: bool) -> dict[int, frozenset[int]]:
        unknown = [uid for uid in sources if (uid, shown) not in self._reached]
        if unknown:
            shapes = dependence.Shapes()
            self._reached |= {(uid, shown): shapes.of(sources[uid], shown=shown) for uid in unknown}
        return {uid: self._reached[uid, shown] for uid in sources}
