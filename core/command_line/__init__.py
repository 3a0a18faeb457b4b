"""The verbs of `python -m core` that are larger than a few lines, one file each."""
