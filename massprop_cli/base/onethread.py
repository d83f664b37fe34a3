"""Linear algebra on one thread: on matrices this small further threads only wait for each other, and take cores from other processes."""

import os

SETTINGS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def prefer() -> None:
    """Ask for it where the environment says nothing else; it must come before numpy is imported."""
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
