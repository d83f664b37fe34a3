"""Arguments of the kernel's hypothesis fits (hypothesis.c, initialbody.c, comparison.c)."""

import ctypes
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from massprop_cli.base.arrays import Array
from massprop_cli.diagnosis.coefficients import RAMP, Model
from massprop_cli.diagnosis.design import SWUNG
from massprop_cli.errorparameters.environment import LEVEL
from massprop_cli.estimate.whitening import ReducedLeastSquares
from massprop_cli.kernel import kernel, pointer

BLOCKS = (
    *("channels", "products", "constant", "rates", "later", "lagging", "smeared", "drifting", "rising", "falling"),
    *("sagging", "ebbing", "aging", "up", "level"),
    *(*LEVEL, *(f"{name} {axis}" for name in SWUNG for axis in range(3)), "slope 0", "slope 1", "precession"),
)
"""Blocks of columns in the kernel's order."""


class Fits(NamedTuple):
    """H fits side by side, where they ended."""

    x: Array
    """(H, nx)"""
    left: Array
    """(H, p, 6)"""
    spread: Array
    """(H, n) one sigma of each unknown."""


class PackedTriangles:
    """Hypotheses tested against two triangles, as the kernel has them."""

    def __init__(
        self,
        model: Model,
        told: Sequence[ReducedLeastSquares],
        noise: Array,
        gyro: Array,
        accelerometer: Array,
        freed: tuple[Array, Array] | None,
    ) -> None:
        self.columns = told[0].triangle.shape[1]
        self._entries = len(model.stated)
        self._sizes = len(gyro), len(model.force), self.columns, self._entries, *(len(one.triangle) for one in told)
        self._places = np.array([model.places[name].start if name in model.places else -1 for name in BLOCKS], ctypes.c_long)
        bearing = np.zeros(3) if model.bearing is None else model.bearing
        parts = (
            *(model.imu, model.mounting, [model.bearing is not None], bearing, [model.gravity], model.level, model.world),
            *(model.room_torque, model.steady),
            *(
                [model.lags["lag"], model.lags["gyro_lag"], model.lags["accel_lag"], RAMP],
                [model.thrusting, model.plant.translates, *model.turns],
                model.position,
                model.force,
                model.couple,
            ),
        )
        self._numbers = np.concatenate([np.ravel(part) for part in parts], dtype=float)
        self._triangles = [np.ascontiguousarray(part.T) for one in told for part in (one.triangle, one.measured)] + [np.sqrt(noise)]
        self._turns = np.ascontiguousarray(np.stack([gyro, accelerometer], 1))
        self._freed = None if freed is None else np.ascontiguousarray(np.concatenate(freed).T)

    def plain(self, x: Array, suspects: NDArray[np.uint8]) -> Array:
        """(N, 9, 3) plain regression of motion on commands of any x (N, nx), where ``suspects`` (N, C) have a response of their own."""
        channels = suspects.shape[1]
        found = np.empty((len(x), 9, 3))
        room = np.empty(6 * channels + self.columns * (4 * channels + 18))
        self._run("mp_host_plain", 0, np.ascontiguousarray(x), suspects, room, found, count=len(x))
        return found

    def begun(self, x: Array, plain: Array) -> tuple[Array, Array]:
        """(H, nx) x with the body that ``plain`` (H, 9, 3) regression makes, and (H, 10) the sizes of its entries."""
        found, sizes = np.ascontiguousarray(x), np.empty((len(x), 10))
        self._run("mp_host_initial_bodies", 0, self._turns, np.ascontiguousarray(plain), found, sizes)
        return found, sizes

    def left(self, x: Array) -> Array:
        """(H, p, 6) what x (H, nx) leave, over the noise."""
        found, room = np.empty((len(x), 6, self.columns)), np.empty(6 * self.columns)
        given = np.ascontiguousarray(x)
        self._run("mp_host_residuals", 0, given, self._turns, self._freed, room, found)
        return found.swapaxes(1, 2)

    def fitted(self, x: Array, moves: Array, pulled: Array, ends: tuple[float, float, int]) -> Fits:
        """Damped Gauss–Newton from x (H, nx) along ``moves`` (H, nx, n), each pulled to where it began by ``pulled`` (n,).

        ``ends``: the change of −2 log likelihood that ends a fit, measurements less coefficients, and the most steps.
        LinAlgError where a step can't be solved for.
        """
        count = len(pulled)
        found = x.copy(), np.empty((len(x), 6, self.columns)), np.empty((len(x), count))
        room = np.empty(18 * self.columns + (6 * self.columns + 2 * count + 2) * count + self._entries)
        given = np.ascontiguousarray(moves), pulled, np.array(ends, dtype=float)
        self._run("mp_host_fitted", count, self._turns, self._freed, *given, room, *found)
        return Fits(found[0], found[1].swapaxes(1, 2), found[2])

    def _run(self, name: str, unknowns: int, *arrays: Array | NDArray[np.uint8] | None, count: int | None = None) -> None:
        every, *shape = self._sizes[:4]
        sizes = np.array([every if count is None else count, *shape, unknowns, *self._sizes[4:]], ctypes.c_long)
        triangles = (ctypes.c_void_p * len(self._triangles))(*(part.ctypes.data for part in self._triangles))
        shared = ctypes.c_void_p(sizes.ctypes.data), ctypes.c_void_p(self._places.ctypes.data), pointer(self._numbers), triangles
        if kernel().compiled[name](*shared, *(None if part is None else pointer(part) for part in arrays)):
            raise np.linalg.LinAlgError("a fit has no next step")
