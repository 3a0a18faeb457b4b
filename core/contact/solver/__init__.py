"""How contact is solved: a compliance and the gaps of nodes -> forces, whatever the scene.

bodies           what is near a finger, and the gaps to it
cone             Coulomb's law and the residual that proves an answer
sweeps           one problem, solved by compiled sweeps from node to node
solve            the same with checks and a proof, for whoever has no path
compliance, halfspace        of a skin, and of an endless block
history          what friction remembers
notes            findings, each kind once
path, path_step  frame after frame along a path
point_path       the same on free points of a smooth pad, with
point_tree       where they are, point_matrix, their compliance, and point_history, which come in whose place
grip             what fingers bring to what they hold
balance          forces that also carry it
grip_solver      what is held, frame after frame
"""
