"""The causal pass in C99, one source for the ground and for flight, and where a compiler has built it, its library."""

import ctypes
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from massprop_cli.base.errors import InputError
from massprop_cli.kernel.compile import built

CHOICE = "MASSPROP_KERNEL"
"""Environment variable; "numpy" keeps the compiled kernel out."""
INTERFACE = 16
"""Of the library's calls, as ``mp_host_interface`` says it."""
BINS, COMMANDS, PENDING, WHEELS, LAGS = 64, 64, 24, 4, 2
"""MP_BINS, MP_COMMANDS, MP_PENDING, MP_WHEELS, MP_LAGS"""


class Kernel(NamedTuple):
    """What runs the causal pass."""

    library: ctypes.CDLL | None
    """None: NumPy does."""
    name: str
    """For run.json: which, and why."""

    @property
    def compiled(self) -> ctypes.CDLL:
        """The library; RuntimeError where NumPy runs."""
        if self.library is None:
            raise RuntimeError("there is no compiled kernel")
        return self.library


@cache
def kernel() -> Kernel:
    """The compiled kernel, where it was built beside this file and is not turned off; :class:`InputError` where another is chosen."""
    chosen = os.environ.get(CHOICE, "")
    if chosen not in ("", "numpy"):
        raise InputError(f"{CHOICE}={chosen}: no such kernel; set numpy, or unset it")
    if chosen == "numpy":
        return Kernel(None, f"NumPy ({CHOICE}=numpy)")
    path = built(Path(__file__).parent)
    if not path.exists():
        return Kernel(None, "NumPy (no compiled kernel was installed)")
    try:
        library = opened(path)
    except (OSError, AttributeError) as error:
        return Kernel(None, f"NumPy ({path.name} cannot be loaded: {error})")
    if library.mp_host_interface() != INTERFACE:
        return Kernel(None, f"NumPy ({path.name} is of another version; install massprop anew)")
    return Kernel(library, "C99, double precision")


def opened(path: Path) -> ctypes.CDLL:
    """A library that was built of the kernel's sources; OSError where it cannot be loaded. Its calls let other threads run.

    AttributeError where it was built of sources that had other calls.
    """
    library = ctypes.CDLL(str(path))
    library.mp_host_interface.restype = ctypes.c_int
    library.mp_host_size.restype = library.mp_host_flight_size.restype = ctypes.c_size_t
    library.mp_host_pass.restype = ctypes.c_void_p
    library.mp_host_flown.restype = ctypes.c_long
    library.mp_host_reference_error.restype = ctypes.c_double
    return library


class Pointer(ctypes.c_void_p):
    """Where an array's numbers stand. A call has it among its arguments, and with it the array, which may have no other name."""

    array: NDArray[np.floating | np.unsignedinteger]


def pointer(array: NDArray[np.floating | np.unsignedinteger]) -> Pointer:
    """Where its numbers stand; there they stay for as long as this is held."""
    found = Pointer(array.ctypes.data)
    found.array = array
    return found


def call(function: Callable[..., Any], *arguments: object) -> Any:
    """What a function of the library gives, handed arrays as the place of their numbers, in one piece, and whole numbers as long ones."""
    return function(
        *(
            pointer(np.ascontiguousarray(one)) if isinstance(one, np.ndarray) else ctypes.c_long(one) if isinstance(one, int) else one
            for one in arguments
        )
    )
