"""Sample Blender's scene for the engine.

The modules, in the order in which data pass them:

participants      the objects that feel, are touched or are screens, instances included
prepass           passes over the range before the first sample: surfaces that change, instances that appear
simulated_motion  motion of simulations, swept at whole frames; motion_pieces has curves from one rest to the next
frames            the range to bake, and the frames of samples at a rate
scene_header      names, parameters, surfaces, reliefs and flaws, before the first sample
height_maps       reliefs of screens; mesh_heights casts them from a mesh, image_files reads the files behind images
meshes            surfaces of evaluated objects; face_cuts follows their triangles
instances         geometry of instances, read from the dependency graph; joined_pieces joins it to one surface,
                  instance_survey lists the instances of a range, instance_samples records them, changes_seen finds
                  whether they must be read again
unfelt            points, curves and volumes that are shown beside a mesh
edit_mode         parts that Edit Mode leaves out of shapes
script_changes    changes that scripts make when the frame changes: followed, or reported
single_precision  objects that move in steps because they are far from the origin
render_differences  differences between renders and the viewport: render_settings compares settings, render_causes
                  finds the objects whose shape they change (dependence follows the users of data), render_surfaces
                  measures the distance of the surfaces
recorder          poses, surfaces and animated parameters at each sample
scene_content     digests of all data that a sweep may depend on, without a sweep
scene_sweep       all samples, in chunks: a `TactileScene`
"""

from .. import on_demand

on_demand.modules_of(globals())
