"""What is likely not meant: looked for before a bake, and mended with a click."""
