"""The command line of the engine.

`verbs.py` has the parser. The modules `*_verbs.py` have the arguments of the verbs, and the other modules the functions
that run them.
"""
