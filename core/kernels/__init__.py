"""The compiled part of the engine: kernels in C, their build and loader.

`building.py` has sources, flags and platforms, and reads `kernels.h`, the interface. `library.py` finds the compiled
file and checks it. `records.py` makes the records of `kernels.h` in Python. A kernel takes one record that points to
arrays of Python; it allocates no memory, and keeps nothing between calls.
"""

COPIES = "DERMIS_KERNELS"  # environment variable with the folder for copies of the library, see `library.py`
