"""Solvers of contact: forces from a compliance and the gaps of nodes, without scenes.

bodies           bodies near a finger, and the gaps to them
cone             Coulomb's law and its residual
sweeps           solver of one problem by compiled sweeps over the nodes; solution: its result, with status and residual
compliance       compliance of a skin
law_skin         correction for nonlinear skin; law_frame: one frame with it
history          anchors of friction
notes            findings, each kind once
path_solver      frame after frame along a path; path_step: one frame
point_solver     the same on points of a smooth pad, with the modules
point_tree       choice of the points by a compiled survey (posed_records: its bodies)
smooth_contact   gaps and forces of points by a compiled solver
point_matrix     compliance between the points; succession: transfer of state to new points
grip             fingers that hold a body, their grips, and its displacement
balance          forces that balance a held body
grip_solver      a held body, frame after frame
"""
