"""Show that Blender's own undo corrupts a scene from which objects were deleted; nothing of Dermis is loaded.

    python tests/blender/undo_defect.py [SEED] [STEPS] [legacy]

An undo step keeps addresses. Where a data-block has changed, undo reads it at a fresh address N, swaps its content
into the block's old address O, and turns every N in that content into O (`BKE_lib_id_swap_full`), before it turns the
step's addresses into today's. Where an object was deleted since, its memory is free, and N may be the very address by
which the step knows that object. The scene then lists itself in the object's place; Blender prints 'add_operation:
Operation already exists - [Hierarchy Component]' and ends with a segmentation fault as it evaluates the scene, which
`ed.undo` and `ed.redo` do at their end. Seen in 4.5.15 and 5.2.3; never with `legacy`, which is Preferences >
Experimental > Undo Legacy.
"""

import os
import random
import sys

import bpy

undone = 0


def look(*_: object) -> None:
    """End where a scene lists as an object what is none, before its evaluation crashes."""
    global undone
    undone += 1
    for scene in bpy.data.scenes:
        strange = {o.as_pointer() for o in scene.collection.objects} - {o.as_pointer() for o in bpy.data.objects}
        if strange:
            itself = scene.as_pointer() in strange
            end(1, f"the scene lists {'itself' if itself else 'freed memory'} as an object")


def end(status: int, what: str) -> None:
    """Say how it went, and leave."""
    print(f"{bpy.app.version_string}, after {undone} undo and redo: {what}", flush=True)
    os._exit(status)


def add() -> None:
    """Add an empty."""
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("E", None))


def change(chance: random.Random) -> None:
    """Do what artists do."""
    objects = list(bpy.data.objects)
    chosen = chance.choice(objects)
    for thing in bpy.context.view_layer.objects:
        thing.select_set(thing == chosen)
    what = chance.randrange(6)
    if what == 0:
        add()
    elif what == 1:
        bpy.ops.object.duplicate()
    elif what == 2:
        chosen.name = chance.choice("ABC")
    elif what == 3:
        chosen.location.x = chance.random()
    elif len(objects) > 2:
        bpy.ops.object.delete() if what == 4 else bpy.data.objects.remove(chosen)


def step(operator: str, **arguments: str) -> None:
    """Call an operator of undo where there is something to undo."""
    call = getattr(bpy.ops.ed, operator)
    if operator == "undo_push" or call.poll():
        call(**arguments)


def walk(seed: int = 1, steps: int = 3000) -> None:
    """Change, undo and redo."""
    chance = random.Random(seed)
    for _ in range(4):
        add()
    step("undo_push", message="start")
    for _ in range(steps):
        what = chance.random()
        if what < 0.5:
            for _ in range(chance.randint(1, 3)):
                step("undo" if what < 0.3 else "redo")
        else:
            change(chance)
            step("undo_push", message="change")


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if "legacy" in sys.argv:
        bpy.context.preferences.view.show_developer_ui = True
        bpy.context.preferences.experimental.use_undo_legacy = True
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        handlers.append(look)
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        walk(*numbers)
    end(0, "sound")
