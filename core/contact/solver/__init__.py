"""How contact is solved: one problem on any compliance, frame after frame along a path."""
