"""Arguments of the kernel's hypothesis fits (hypothesis.c, initialbody.c, comparison.c)."""

import ctypes
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from massprop_cli.base.arrays import Array
from massprop_cli.diagnosis.coefficients import RAMP, Model
from massprop_cli.diagnosis.design import GYRO_ERRORS
from massprop_cli.errorparameters.environment import LEVEL
from massprop_cli.estimate.whitening import ReducedLeastSquares
from massprop_cli.kernel import kernel, pointer

BLOCKS = (
    *("channels", "products", "constant", "rates", "later", "lagging", "smeared", "drifting", "rising", "falling"),
    *("sagging", "ebbing", "aging", "up", "level"),
    *(*LEVEL, *(f"{name} {axis}" for name in GYRO_ERRORS for axis in range(3)), "slope 0", "slope 1", "precession"),
)
"""Column blocks in the kernel's order."""


class Fits(NamedTuple):
    """Results of H fits."""

    x: Array
    """(H, nx) fitted x."""
    residuals: Array
    """(H, p, 6) residuals over the noise."""
    spread: Array
    """(H, n) sigma of each unknown."""


class PackedTriangles:
    """Square-root information of a log and H hypotheses, packed for the kernel."""

    def __init__(
        self,
        model: Model,
        sensors: Sequence[ReducedLeastSquares],
        noise: Array,
        gyro: Array,
        accelerometer: Array,
        freed: tuple[Array, Array] | None,
    ) -> None:
        self.columns = sensors[0].triangle.shape[1]
        self._entries = len(model.stated)
        self._sizes = len(gyro), len(model.force), self.columns, self._entries, *(len(one.triangle) for one in sensors)
        self._places = np.array([model.places[name].start if name in model.places else -1 for name in BLOCKS], ctypes.c_long)
        bearing = np.zeros(3) if model.bearing is None else model.bearing
        numbers = (
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
        self._numbers = np.concatenate([np.ravel(part) for part in numbers], dtype=float)
        self._triangles = [np.ascontiguousarray(part.T) for one in sensors for part in (one.triangle, one.measured)] + [np.sqrt(noise)]
        self._turns = np.ascontiguousarray(np.stack([gyro, accelerometer], 1))
        self._freed = None if freed is None else np.ascontiguousarray(np.concatenate(freed).T)

    def regressed(self, x: Array, suspects: NDArray[np.uint8]) -> Array:
        """(N, 9, 3) regressions of motion on commands for x (N, nx), with free responses of the channels ``suspects`` (N, C)."""
        channels = suspects.shape[1]
        regressions = np.empty((len(x), 9, 3))
        workspace = np.empty(6 * channels + self.columns * (4 * channels + 18))
        self._run("mp_host_plain", 0, np.ascontiguousarray(x), suspects, workspace, regressions, count=len(x))
        return regressions

    def initial(self, x: Array, regressions: Array) -> tuple[Array, Array]:
        """(H, nx) x with initial bodies from regressions (H, 9, 3), and (H, 10) sizes of θ."""
        start, sizes = np.ascontiguousarray(x), np.empty((len(x), 10))
        self._run("mp_host_initial_bodies", 0, self._turns, np.ascontiguousarray(regressions), start, sizes)
        return start, sizes

    def residuals(self, x: Array) -> Array:
        """(H, p, 6) residuals of x (H, nx), over the noise."""
        residuals, workspace = np.empty((len(x), 6, self.columns)), np.empty(6 * self.columns)
        start = np.ascontiguousarray(x)
        self._run("mp_host_residuals", 0, start, self._turns, self._freed, workspace, residuals)
        return residuals.swapaxes(1, 2)

    def fitted(self, x: Array, directions: Array, prior_root: Array, ends: tuple[float, float, int]) -> Fits:
        """Fit x (H, nx) by damped Gauss–Newton along ``directions`` (H, nx, n), with prior square-root information ``prior_root`` (n,).

        ``ends``: the change of −2 log likelihood that ends a fit, degrees of freedom, and the most steps. Raise LinAlgError if a step
        cannot be solved for.
        """
        count = len(prior_root)
        results = x.copy(), np.empty((len(x), 6, self.columns)), np.empty((len(x), count))
        workspace = np.empty(18 * self.columns + (6 * self.columns + 2 * count + 2) * count + self._entries)
        inputs = np.ascontiguousarray(directions), prior_root, np.array(ends, dtype=float)
        self._run("mp_host_fitted", count, self._turns, self._freed, *inputs, workspace, *results)
        return Fits(results[0], results[1].swapaxes(1, 2), results[2])

    def _run(self, name: str, unknowns: int, *arrays: Array | NDArray[np.uint8] | None, count: int | None = None) -> None:
        hypotheses, *shape = self._sizes[:4]
        sizes = np.array([hypotheses if count is None else count, *shape, unknowns, *self._sizes[4:]], ctypes.c_long)
        triangles = (ctypes.c_void_p * len(self._triangles))(*(part.ctypes.data for part in self._triangles))
        shared = ctypes.c_void_p(sizes.ctypes.data), ctypes.c_void_p(self._places.ctypes.data), pointer(self._numbers), triangles
        if kernel().compiled[name](*shared, *(None if part is None else pointer(part) for part in arrays)):
            raise np.linalg.LinAlgError("a fit has no next step")
