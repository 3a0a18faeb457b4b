"""The command line: `verbs.py` says what may be typed; what verbs do stands in one file for what each takes."""
