"""How contact is solved: a compliance and the gaps of nodes -> forces, whatever the scene.

bodies           the objects near a finger, and the gaps to them
cone             Coulomb's law and the residual that proves an answer
sweeps           one problem, solved by compiled sweeps from node to node
solve            the same with checks and a proof, for whoever has no path
compliance, halfspace        of a skin, and of an endless block
history          the anchors of friction
notes            findings, each kind once
path_solver      frame after frame along a path; path_step: one of them
point_solver     the same on free points of a smooth pad, with
point_tree       where they are, by a compiled survey (posed_records: its bodies; moved_skin: its skin)
point_matrix     their compliance, and succession, which come in whose place
grip             the fingers that hold an object, their grips, and how far it is displaced
balance          forces that also carry it
grip_solver      the held object, frame after frame
"""
