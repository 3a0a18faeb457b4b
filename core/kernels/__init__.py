"""The compiled part of the engine: small kernels in C, the recipe that builds them, and their loader.

`building.py` has sources, flags and platforms, `library.py` finds the file and checks it, `records.py` mirrors the
records of `kernels.h`. Kernels take one record of arrays that Python allocated; they allocate and keep nothing.
"""

COPIES = "DERMIS_KERNELS"  # environment variable: the folder of the copies that are loaded, see `library.py`
