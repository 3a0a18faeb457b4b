"""Find the settings by which renders show felt objects differently.

They are settings of the objects, and of the sources of their shapes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import bpy

from . import dependence, participants, render_settings, script_changes
from .participants import Participants
from .render_settings import has_settings, instancer, rendering, seen_by_camera, settings, visibility

Words = dict[int, list[str]]  # texts by session uid; data without a text are left out


class RenderCauses:
    """Watcher of the settings that differ, from frame to frame.

    Attributes:
        vary: whether settings may change within the range, because they are animated or scripts run.
    """

    def __init__(self, swept: Participants, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
        self._scene, self._view_layer = scene, view_layer
        screens = participants.look_up({e.uid for e in swept.screens}).values()
        meshes = {screen.dermis.screen.mesh_object for screen in screens} - {None}
        self._own = {e.uid for e in swept.bodies if e.instance is None}  # felt at their own place
        self._instanced = {e.uid for e in swept.bodies if e.instance is not None} - self._own
        self._felt = self._own | self._instanced | {mesh.session_uid for mesh in meshes}
        makers = {e.instance.instancer for e in swept.bodies if e.instance is not None}
        self._makers = makers - self._felt  # objects that are not felt, but whose instances are
        self._varying = {o.session_uid for o in bpy.data.objects if render_settings.animated(o)}
        self._all_vary = script_changes.run_here() or render_settings.simplify_animated(scene)
        self.vary = self._all_vary or bool(self._varying)
        self._looked = False
        self._settings: Words = {}
        self._instancer: Words = {}
        self._visibility: Words = {}  # of objects and collections
        self._rendering: set[int] = set()  # objects in collections that renders show
        self._reached: dict[tuple[int, bool], frozenset[int]] = {}  # the objects that get their shape from a source

    def look(self, objects: Mapping[int, bpy.types.Object]) -> None:
        """Compare the present settings.

        The first call compares all of them, later calls those that may have changed.
        """
        every = self._all_vary or not self._looked
        for uid in objects if every else self._varying & objects.keys():
            obj = objects[uid]  # with scripts, these are all objects at every frame, so quick tests come first
            if has_settings(obj) or uid in self._settings:
                _keep(self._settings, uid, settings(obj, self._scene))
            if obj.is_instancer or uid in self._instancer:
                _keep(self._instancer, uid, instancer(obj))
            if obj.hide_viewport != obj.hide_render or uid in self._visibility:
                _keep(self._visibility, uid, visibility(obj))
        if every:
            for collection in bpy.data.collections:
                _keep(self._visibility, collection.session_uid, visibility(collection))
            layer = self._view_layer.layer_collection
            self._rendering = {o.session_uid for c in rendering(layer) for o in c.objects}
        if not self._looked:
            self._find_makers(objects)
        self._looked = True

    def hidden(self, objects: Mapping[int, bpy.types.Object]) -> set[int]:
        """Return session uids of enabled felt objects that renders do not show."""
        shown = (self._felt - self._instanced) & objects.keys()
        out = {uid for uid in shown if not (uid in self._rendering and seen_by_camera(objects[uid]))}
        instanced = {uid: objects[uid] for uid in self._instanced & self._visibility.keys() & objects.keys()}
        out |= {uid for uid, users in self._reach(instanced, shown=True).items() if users & self._makers}
        return self._enabled(out, objects)

    def differing(self, objects: Mapping[int, bpy.types.Object]) -> Words:
        """Return texts on the present differences, by session uid.

        They are those of enabled felt objects and of the makers of felt instances.
        """
        out: Words = {}
        if not (self._settings or self._instancer or self._visibility):
            return out
        concerned = self._felt | self._makers
        for words, among in ((self._settings, concerned), (self._instancer, self._felt)):
            for uid in words.keys() & among:
                out.setdefault(uid, []).extend(words[uid])
        known = {**objects, **{c.session_uid: c for c in bpy.data.collections}}
        for words, shown, glue in ((self._settings, False, ": "), (self._visibility, True, " ")):
            sources = {uid: known[uid] for uid in words if uid in known}
            for uid, users in self._reach(sources, shown=shown).items():
                for user in users & concerned:
                    if user in self._felt or uid not in self._felt:  # else the felt source is reported itself
                        said = [f"{sources[uid].name_full}{glue}{said}" for said in words[uid]]
                        out.setdefault(user, []).extend(said)
        there = self._enabled(out, objects)
        return {uid: said for uid, said in out.items() if uid in there}

    def _find_makers(self, objects: Mapping[int, bpy.types.Object]) -> None:
        """Add the objects that show instances of felt objects in renders only."""
        others = {uid for uid in self._settings.keys() - self._felt if _instances(objects[uid])}
        if others:
            shapes = dependence.Shapes()
            self._makers |= others & {u for uid in self._felt & objects.keys() for u in shapes.of(objects[uid])}

    def _enabled(self, uids: Iterable[int], objects: Mapping[int, bpy.types.Object]) -> set[int]:
        found = {uid for uid in uids if uid in objects}
        return {u for u in found if u not in self._own or not participants.is_disabled(objects[u], self._view_layer)}

    def _reach(self, sources: Mapping[int, bpy.types.ID], *, shown: bool) -> dict[int, frozenset[int]]:
        unknown = [uid for uid in sources if (uid, shown) not in self._reached]
        if unknown:
            shapes = dependence.Shapes()
            self._reached |= {(uid, shown): shapes.of(sources[uid], shown=shown) for uid in unknown}
        return {uid: self._reached[uid, shown] for uid in sources}


def _keep(words: Words, uid: int, said: list[str]) -> None:
    if said:
        words[uid] = said
    else:
        words.pop(uid, None)


def _instances(obj: bpy.types.Object) -> bool:
    return bool(obj.is_instancer) or len(obj.particle_systems) > 0
