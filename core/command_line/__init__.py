"""The command line: `verbs.py` has the parser; the functions of verbs stand in one file per kind of input."""
