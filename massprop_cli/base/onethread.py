"""Single-threaded linear algebra: on small matrices more threads only wait for each other and take cores from other processes."""

import os

SETTINGS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def prefer() -> None:
    """Set one thread unless the environment sets another number; call this before importing numpy."""
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
