"""Solvers of contact: forces from a compliance and the gaps of nodes, without scenes.

bodies           bodies near a finger, and the gaps to them
cone             Coulomb's law and its residual
sweeps           solver of one problem by compiled sweeps over the nodes; solution: its result, with status and residual
compliance       compliance of a skin
law_skin         correction for nonlinear skin; law_frame: one frame with it
history          anchors of friction
notes            findings, each kind once
contact_points   points at which contact is solved: nodes of a mesh, or pad_points of a smooth pad
path_solver      frame after frame along a path; path_step: one frame
point_tree       choice of a pad's points by a compiled survey (posed_records: its bodies)
smooth_contact   gaps and forces of points by a compiled solver
point_matrix     compliance between the points; succession: transfer of state to new points
grip             fingers that hold a body, their grips, and its displacement
balance          forces that balance a held body
grip_solver      a held body, frame after frame
"""
