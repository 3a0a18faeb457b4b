"""Seeded stress: scenes, surfaces, pins, mechanisms and tracks drawn at random, each held to the laws it must obey.

`python3 build_addon.py stress` runs them; a case is a family's name and a seed, and is judged alone by
`python3 build_addon.py stress NAME --seed S --runs 1`. `tolerances` has what each law is held to, and why.
"""
