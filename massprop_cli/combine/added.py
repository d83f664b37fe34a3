"""A known object as the scale: logs without it and with it give inertia, first moment, mass and the scale of thrust or wheels.

A log gives inertia, first moment and mass in units of the stated thrust (or momentum of wheels): q times the true ones, q = stated over
true thrust, the same in all logs. About one point of the body the true ones add up: with e = (I, m c, m) of what turns and a(w) of an
object w = (inertia about its own CG, place, mass),

    y₁ = g(e, q) + ν₁,   y₂ = g(e + a(w), q) + ν₂,   w₀ = w + ν₃,

g the ten quantities as logs give them, on a fixed pedestal the nine about the pivot. Least squares over e, q and w by Gauss-Newton.
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
"""Relative sigma of what is stated without one."""
STEPS, SETTLED, DISTANT = 30, 1e-6, 4.0
"""Most steps of Gauss-Newton; of a sigma, the last one's; sigmas by which known values may be apart."""
_ITEM = re.compile(r"(\w+)=([^\s±]+?)(?:(?:\+-|\+/-|±)(\S+))?")
Known = Mapping[str, tuple[float, float]]


def stated(text: str) -> Known:
    """Value and sigma of each quantity of the object that ``--added`` states; :class:`InputError` says how to write it."""
    found: dict[str, tuple[float, float]] = {}
    for item in text.split():
        parts = _ITEM.fullmatch(item)
        names = KEYS.get(parts[1]) if parts else None
        if parts is None or names is None or names[0] in found:
            raise InputError(f"--added {item!r}: not one of mass, position and inertia, each stated once; {EXAMPLE}", "added")
        try:
            values, sigma = [float(one) for one in parts[2].split(",")], float(parts[3] or 0)
        except ValueError:
            values, sigma = [], 0.0
        if len(values) != len(names) or not np.isfinite([*values, sigma]).all() or sigma < 0:
            raise InputError(f"--added {item!r}: not {len(names)} finite numbers and a sigma that is not negative; {EXAMPLE}", "added")
        found |= {name: (value, sigma) for name, value in zip(names, values, strict=True)}
    for key in ("mass", "position"):
        if KEYS[key][0] not in found:
            raise InputError(f"--added: states no {key} of the object; {EXAMPLE}", "added")
    if not found["mass"][0] > 0:
        raise InputError(f"--added: a mass of {found['mass'][0]:g} kg; name the results without the object by --before", "added")
    return found


@dataclass(frozen=True)
class Side:
    """What logs without, or with, the object say by themselves at the stated thrust."""

    name: str
    values: Array
    """(10,) NaN where nothing can be said."""
    covariance: Array
    at: Array
    """(3,) the bearing or the pivot."""
    bearing_mass: float
    about_pivot: bool
    """Whether these are the nine about a fixed pivot, and no mass."""
    known: Known
    """Measured elsewhere, of the ten."""

    def seen(self, true: Array, q: float) -> Array:
        """(10,) as its logs give them, of e (10,)."""
        if self.about_pivot:
            return np.append(q * true[:9], np.nan)
        mass = q * (true[9] + self.bearing_mass)
        inertia = true[:6] - elements(parallel_axis(1 / true[9], true[6:9]))
        arm = (true[6:9] - true[9] * self.at) * q / (mass - self.bearing_mass)
        return np.concatenate([q * inertia, self.at + arm, [mass]])

    @property
    def true(self) -> Array:
        """(10,) e at the stated thrust; 0 where nothing can be said."""
        ten = np.nan_to_num(self.values)
        if self.about_pivot:
            return ten
        turning = ten[9] - self.bearing_mass
        return np.concatenate([ten[:6] + elements(parallel_axis(turning, ten[6:9])), turning * ten[6:9], [turning]])


@dataclass(frozen=True)
class Calibrated:
    """What both sides and the object come to."""

    sides: tuple[tuple[Array, Array], tuple[Array, Array]]
    """(10,) and (10, 10) of each; NaN where nothing can be said."""
    added: tuple[Array, Array]
    """The same of the object."""
    scale: tuple[float, float]
    """Thrust, or momentum of wheels, over what is stated, and its sigma."""
    chi_square: float
    freedom: int


def calibrated(sides: tuple[Side, Side], known: Known, scale_sigma: float) -> Calibrated:
    """Both sides in absolute terms; ``scale_sigma`` of the thrust as stated, 0: not known at all."""
    fit = _Fit(sides, known, scale_sigma)
    found = _solved(fit, fit.start, [])
    rows = [(half, name, *pair) for half, side in enumerate(sides) for name, pair in side.known.items()]
    for half, name, value, sigma in rows:
        told, spread = fit.reported(found, half)
        i = QUANTITIES.index(name)
        apart = abs(told[i] - value) / np.hypot(sigma, np.sqrt(spread[i, i]))
        if apart > DISTANT:
            raise InputError(
                f"{sides[half].name}: known.{name} = {value:g} ± {sigma:g} and --added contradict each other by {apart:.3g} sigma (with "
                f"--added it is {told[i]:.6g} ± {np.sqrt(spread[i, i]):.2g}); check both",
                "added",
            )
    if rows:
        found = _solved(fit, found.at, rows)
    q, sigma = found.at[fit.scale], np.sqrt(found.covariance[fit.scale, fit.scale])
    objects = np.full((10, 10), np.nan)
    objects[np.ix_(fit.free, fit.free)] = found.covariance[fit.scale + 1 :, fit.scale + 1 :]
    values = np.full(10, np.nan)
    values[fit.free] = found.at[fit.scale + 1 :]
    first, second = (fit.reported(found, half) for half in (0, 1))
    return Calibrated((first, second), (values, objects), (1 / q, sigma / q**2), found.chi_square, found.freedom)


@dataclass(frozen=True)
class _Found:
    at: Array
    covariance: Array
    chi_square: float
    freedom: int


class _Fit:
    """Unknowns: e where it is told, q, and w but for inertia that has no part."""

    def __init__(self, sides: tuple[Side, Side], known: Known, scale_sigma: float) -> None:
        self.sides, self.scale_sigma = sides, scale_sigma
        told = [np.isfinite(side.values) & np.isfinite(np.diag(side.covariance)) for side in sides]
        self.told = np.flatnonzero(told[0] & told[1])
        for side, own in zip(sides, told, strict=True):
            if not own[6:9].any() or (own != (told[0] | told[1])).any():
                raise InputError(
                    f"{side.name}: does not show all that --added is to be the scale of; command motion about and along more axes", "added"
                )
        given = np.array([known.get(name, (np.nan, np.nan)) for name in QUANTITIES])
        self.stated = np.flatnonzero(np.isfinite(given[:, 0]))
        self.values, sigmas = given[:, 0], given[:, 1]
        sizes = np.repeat([1.0, 0.1, known["mass"][0]], [6, 3, 1])
        self.sigmas = np.maximum(sigmas, EXACT * sizes)
        self.free = np.union1d(self.stated, self.told[self.told < 6])
        self.scale = len(self.told)
        self.white = [np.linalg.inv(np.linalg.cholesky(side.covariance[np.ix_(self.told, self.told)])) for side in sides]
        self.start = np.concatenate([sides[0].true[self.told], [1.0], np.nan_to_num(self.values[self.free])])

    def parts(self, unknown: Array, half: int) -> tuple[Array, float, Array]:
        """Of a side: e (10,), q, and w (10,)."""
        true, w = np.zeros(10), np.zeros(10)
        true[self.told], w[self.free] = unknown[: self.scale], unknown[self.scale + 1 :]
        if half:
            arm = w[6:9] - self.sides[1].at * self.sides[1].about_pivot
            true = true + np.concatenate([w[:6] + elements(parallel_axis(w[9], arm)), w[9] * arm, [w[9]]])
        return true, unknown[self.scale], w

    def residuals(self, unknown: Array, known: Sequence[tuple[int, str, float, float]]) -> Array:
        """(n,) independent, of one sigma each."""
        rows = []
        for half, (side, white) in enumerate(zip(self.sides, self.white, strict=True)):
            true, q, w = self.parts(unknown, half)
            rows.append(white @ (side.seen(true, q) - side.values)[self.told])
        rows.append(((w - self.values) / self.sigmas)[self.stated])
        if self.scale_sigma > 0:
            rows.append(np.array([(1 / q - 1) / self.scale_sigma]))
        for half, name, value, sigma in known:
            true, _, _ = self.parts(unknown, half)
            rows.append(np.array([(self.sides[half].seen(true, 1.0)[QUANTITIES.index(name)] - value) / sigma]))
        return np.concatenate(rows)

    def reported(self, found: _Found, half: int) -> tuple[Array, Array]:
        """(10,) and (10, 10) of a side at the true thrust."""

        def ten(unknown: Array) -> Array:
            return self.sides[half].seen(self.parts(unknown, half)[0], 1.0)[self.told]

        slope = _slope(ten, found.at)
        values, covariance = np.full(10, np.nan), np.full((10, 10), np.nan)
        values[self.told], covariance[np.ix_(self.told, self.told)] = ten(found.at), slope @ found.covariance @ slope.T
        return values, covariance


def _solved(fit: _Fit, start: Array, known: Sequence[tuple[int, str, float, float]]) -> _Found:
    at = start
    for _ in range(STEPS):
        slope, left = _slope(lambda unknown: fit.residuals(unknown, known), at), fit.residuals(at, known)
        size = np.sqrt((slope**2).sum(0))
        basis, triangle = np.linalg.qr(slope / size)
        step = -np.linalg.solve(triangle, basis.T @ left) / size
        at, root = at + step, np.linalg.inv(triangle) / size[:, None]
        covariance = root @ root.T
        if not np.isfinite(at).all() or at[fit.scale] <= 0:
            break
        if (np.abs(step) < SETTLED * np.sqrt(np.diag(covariance))).all():
            left = fit.residuals(at, known)
            return _Found(at, covariance, float(left @ left), len(left) - len(at))
    raise InputError(
        f"--added: {fit.sides[1].name} does not differ from {fit.sides[0].name} by such an object: check its mass, its position from "
        "O in body axes, and whether --before and --after are swapped; if all are right add more mass, farther out",
        "added",
    )


def _slope(of: Callable[[Array], Array], at: Array) -> Array:
    """(n, u) derivative by central differences, of what is smooth in each unknown's own size."""
    sizes = 1e-6 * np.maximum(np.abs(at), 1e-3)
    columns = [(of(at + size * unit) - of(at - size * unit)) / (2 * size) for size, unit in zip(sizes, np.eye(len(at)), strict=True)]
    return np.stack(columns, 1)
