"""Arrays for the kernels, called without the classes of `core`: with any library, and any numbers."""
