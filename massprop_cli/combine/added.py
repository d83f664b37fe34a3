"""Calibration of thrust or wheel momentum by a known object, from logs without it and with it.

A log gives inertia, first moment and mass times q, the ratio of stated to true thrust (or wheel momentum), which is the same in all logs.
The true values e = (I, m c, m) of the rotating body about one point are additive, with a(w) for an object w = (inertia about its own CG,
position, mass):

    y₁ = g(e, q) + ν₁,   y₂ = g(e + a(w), q) + ν₂,   w₀ = w + ν₃.

g gives the ten quantities of a log, or the nine about a fixed pivot. Least squares for e, q and w by Gauss-Newton.
"""

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from massprop_cli import CG, INERTIA, QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.rigidbody import elements, parallel_axis

EXAMPLE = 'write for instance --added "mass=0.5+-0.001 position=0.1,0,0.2+-0.001", in kg and m from O'
KEYS = {"mass": ("mass",), "position": CG, "inertia": INERTIA}
EXACT = 1e-9
"""Relative sigma of a value that is stated without one."""
STEPS, SETTLED, DISTANT = 30, 1e-6, 4.0
"""Most Gauss-Newton steps; last step, in sigmas; largest difference between known values and the fit, in sigmas."""
_ITEM = re.compile(r"(\w+)=([^\s±]+?)(?:(?:\+-|\+/-|±)(\S+))?")
Known = Mapping[str, tuple[float, float]]


def stated(text: str) -> Known:
    """Parse ``--added``: value and sigma of each stated quantity of the object; :class:`InputError` shows the syntax."""
    found: dict[str, tuple[float, float]] = {}
    for item in text.split():
        parts = _ITEM.fullmatch(item)
        names = KEYS.get(parts[1]) if parts else None
        if parts is None or names is None or names[0] in found:
            raise InputError(f"--added {item!r}: state mass, position and inertia, each once; {EXAMPLE}", "added")
        try:
            values, sigma = [float(one) for one in parts[2].split(",")], float(parts[3] or 0)
        except ValueError:
            values, sigma = [], 0.0
        if len(values) != len(names) or not np.isfinite([*values, sigma]).all() or sigma < 0:
            raise InputError(
                f"--added {item!r}: expected {len(names)} finite number{'s' * (len(names) > 1)} and a sigma of at least 0; {EXAMPLE}",
                "added",
            )
        found |= {name: (value, sigma) for name, value in zip(names, values, strict=True)}
    for key in ("mass", "position"):
        if KEYS[key][0] not in found:
            raise InputError(f"--added: {key} of the object is missing; {EXAMPLE}", "added")
    if not found["mass"][0] > 0:
        raise InputError(
            f"--added: mass = {found['mass'][0]:g} kg must be above 0; name the results without the object by --before", "added"
        )
    return found


@dataclass(frozen=True)
class Side:
    """Combined result of the logs without the object, or with it, at the stated thrust."""

    name: str
    values: Array
    """(10,) quantities; NaN without an estimate."""
    covariance: Array
    """(10, 10) their covariance."""
    at: Array
    """(3,) bearing or pivot, m."""
    bearing_mass: float
    """Mass of the bearing, kg."""
    about_pivot: bool
    """Whether the values are the nine about a fixed pivot, without mass."""
    known: Known
    """Known values of the ten quantities."""

    def measured(self, true: Array, q: float) -> Array:
        """g(e, q) (10,): quantities that the logs give for e = ``true`` (10,)."""
        if self.about_pivot:
            return np.append(q * true[:9], np.nan)
        mass = q * (true[9] + self.bearing_mass)
        inertia = true[:6] - elements(parallel_axis(1 / true[9], true[6:9]))
        arm = (true[6:9] - true[9] * self.at) * q / (mass - self.bearing_mass)
        return np.concatenate([q * inertia, self.at + arm, [mass]])

    @property
    def true(self) -> Array:
        """(10,) e for q = 1; 0 without an estimate."""
        ten = np.nan_to_num(self.values)
        if self.about_pivot:
            return ten
        rotating = ten[9] - self.bearing_mass
        return np.concatenate([ten[:6] + elements(parallel_axis(rotating, ten[6:9])), rotating * ten[6:9], [rotating]])


@dataclass(frozen=True)
class Calibrated:
    """Calibrated sides and object."""

    sides: tuple[tuple[Array, Array], tuple[Array, Array]]
    """(10,) values and (10, 10) covariance of each side; NaN without an estimate."""
    added: tuple[Array, Array]
    """(10,) values and (10, 10) covariance of the object; NaN without an estimate."""
    scale: tuple[float, float]
    """True over stated thrust, or wheel momentum, and its sigma."""
    chi_square: float
    freedom: int


def calibrated(sides: tuple[Side, Side], known: Known, scale_sigma: float) -> Calibrated:
    """Calibrate both sides by a known object; ``scale_sigma``: stated relative sigma of the thrust, 0: unknown.

    :class:`InputError` if known values contradict the object, or the sides do not differ by such an object.
    """
    fit = _Fit(sides, known, scale_sigma)
    found = _solved(fit, fit.start, [])
    rows = [(half, name, *pair) for half, side in enumerate(sides) for name, pair in side.known.items()]
    for half, name, value, sigma in rows:
        estimate, covariance = fit.calibrated_side(found, half)
        i = QUANTITIES.index(name)
        distance = abs(estimate[i] - value) / np.hypot(sigma, np.sqrt(covariance[i, i]))
        if distance > DISTANT:
            raise InputError(
                f"{sides[half].name}: known.{name} = {value:g} ± {sigma:g} and --added contradict each other by {distance:.3g} sigma (with "
                f"--added it is {estimate[i]:.6g} ± {np.sqrt(covariance[i, i]):.2g}); check both",
                "added",
            )
    if rows:
        found = _solved(fit, found.at, rows)
    q, sigma = found.at[fit.scale], np.sqrt(found.covariance[fit.scale, fit.scale])
    objects = np.full((10, 10), np.nan)
    objects[np.ix_(fit.free, fit.free)] = found.covariance[fit.scale + 1 :, fit.scale + 1 :]
    values = np.full(10, np.nan)
    values[fit.free] = found.at[fit.scale + 1 :]
    first, second = (fit.calibrated_side(found, half) for half in (0, 1))
    return Calibrated((first, second), (values, objects), (1 / q, sigma / q**2), found.chi_square, found.freedom)


@dataclass(frozen=True)
class _Found:
    """Least-squares solution."""

    at: Array
    """(u,) unknowns."""
    covariance: Array
    """(u, u) their covariance."""
    chi_square: float
    freedom: int


class _Fit:
    """Least-squares problem with the unknowns e (components with estimates), q and w (stated components and estimated inertia)."""

    def __init__(self, sides: tuple[Side, Side], known: Known, scale_sigma: float) -> None:
        self.sides, self.scale_sigma = sides, scale_sigma
        finite = [np.isfinite(side.values) & np.isfinite(np.diag(side.covariance)) for side in sides]
        self.estimated = np.flatnonzero(finite[0] & finite[1])
        for side, own in zip(sides, finite, strict=True):
            if not own[6:9].any() or (own != (finite[0] | finite[1])).any():
                raise InputError(
                    f"{side.name}: does not inform every quantity that --added scales; command motion about and along more axes", "added"
                )
        given = np.array([known.get(name, (np.nan, np.nan)) for name in QUANTITIES])
        self.stated = np.flatnonzero(np.isfinite(given[:, 0]))
        self.values, sigmas = given[:, 0], given[:, 1]
        sizes = np.repeat([1.0, 0.1, known["mass"][0]], [6, 3, 1])
        self.sigmas = np.maximum(sigmas, EXACT * sizes)
        self.free = np.union1d(self.stated, self.estimated[self.estimated < 6])
        self.scale = len(self.estimated)
        self.white = [np.linalg.inv(np.linalg.cholesky(side.covariance[np.ix_(self.estimated, self.estimated)])) for side in sides]
        self.start = np.concatenate([sides[0].true[self.estimated], [1.0], np.nan_to_num(self.values[self.free])])

    def parts(self, unknown: Array, half: int) -> tuple[Array, float, Array]:
        """Vector e (10,) of a side, scale q, and vector w (10,)."""
        true, w = np.zeros(10), np.zeros(10)
        true[self.estimated], w[self.free] = unknown[: self.scale], unknown[self.scale + 1 :]
        if half:
            arm = w[6:9] - self.sides[1].at * self.sides[1].about_pivot
            true = true + np.concatenate([w[:6] + elements(parallel_axis(w[9], arm)), w[9] * arm, [w[9]]])
        return true, unknown[self.scale], w

    def residuals(self, unknown: Array, known: Sequence[tuple[int, str, float, float]]) -> Array:
        """(n,) whitened residuals; ``known``: side, quantity, value and sigma of known values."""
        rows = []
        for half, (side, white) in enumerate(zip(self.sides, self.white, strict=True)):
            true, q, w = self.parts(unknown, half)
            rows.append(white @ (side.measured(true, q) - side.values)[self.estimated])
        rows.append(((w - self.values) / self.sigmas)[self.stated])
        if self.scale_sigma > 0:
            rows.append(np.array([(1 / q - 1) / self.scale_sigma]))
        for half, name, value, sigma in known:
            true, _, _ = self.parts(unknown, half)
            rows.append(np.array([(self.sides[half].measured(true, 1.0)[QUANTITIES.index(name)] - value) / sigma]))
        return np.concatenate(rows)

    def calibrated_side(self, found: _Found, half: int) -> tuple[Array, Array]:
        """Values (10,) and covariance (10, 10) of a side at the true thrust."""

        def ten(unknown: Array) -> Array:
            return self.sides[half].measured(self.parts(unknown, half)[0], 1.0)[self.estimated]

        slope = _slope(ten, found.at)
        values, covariance = np.full(10, np.nan), np.full((10, 10), np.nan)
        values[self.estimated], covariance[np.ix_(self.estimated, self.estimated)] = ten(found.at), slope @ found.covariance @ slope.T
        return values, covariance


def _solved(fit: _Fit, start: Array, known: Sequence[tuple[int, str, float, float]]) -> _Found:
    """Gauss-Newton solution from ``start``; :class:`InputError` if it does not converge."""
    at = start
    for _ in range(STEPS):
        slope, residual = _slope(lambda unknown: fit.residuals(unknown, known), at), fit.residuals(at, known)
        size = np.sqrt((slope**2).sum(0))
        basis, triangle = np.linalg.qr(slope / size)
        step = -np.linalg.solve(triangle, basis.T @ residual) / size
        at, root = at + step, np.linalg.inv(triangle) / size[:, None]
        covariance = root @ root.T
        if not np.isfinite(at).all() or at[fit.scale] <= 0:
            break
        if (np.abs(step) < SETTLED * np.sqrt(np.diag(covariance))).all():
            residual = fit.residuals(at, known)
            return _Found(at, covariance, float(residual @ residual), len(residual) - len(at))
    raise InputError(
        f"--added: the difference of {fit.sides[1].name} and {fit.sides[0].name} is not this object: check its mass, its position from O "
        "in body axes, and whether --before and --after are swapped; if all are right, add more mass farther from the CG",
        "added",
    )


def _slope(of: Callable[[Array], Array], at: Array) -> Array:
    """(n, u) derivative of a function of the unknowns (u,), by central differences."""
    sizes = 1e-6 * np.maximum(np.abs(at), 1e-3)
    columns = [(of(at + size * unit) - of(at - size * unit)) / (2 * size) for size, unit in zip(sizes, np.eye(len(at)), strict=True)]
    return np.stack(columns, 1)
