"""From Blender to the engine: who takes part, and where everything is at every sample, in the order of the data.

participants      which objects feel, are touched or are screens, instances among them
prepass           passes over the range before: which surfaces change, which instances appear
simulated_motion  motion of simulations, swept at whole frames; motion_pieces has curves from one rest to the next
frames            the range to bake, and the frames nearest to a steady rate
scene_header      names, parameters and flaws, before the first sample
height_maps       relief of screens; mesh_heights casts it from a mesh, image_files knows the files behind images
meshes            the vertices of an evaluated object
instances         geometry of instances, read from the dependency graph; joined_pieces makes one surface of it,
                  instance_survey lists those of a range, instance_samples records it, changes_seen says when it need
                  not be read again
unfelt            points, curves and volumes that are shown beside a mesh
edit_mode         parts that Edit Mode leaves out of shapes
script_changes    changes that scripts make at changes of the frame: followed, or reported
single_precision  who moves in steps because it is far from the origin
render_differences  differences of renders: render_settings compares settings, render_causes finds whose shape
                  they change (dependence follows the users of data), render_surfaces measures how far
recorder          poses, surfaces and animated parameters at one sample
scene_sweep       all samples, in chunks: a `TactileScene`
"""

from .. import on_demand

on_demand.modules_of(globals())
