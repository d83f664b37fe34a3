"""Inertia about a fixed pivot, and first moment, against the Cramér–Rao bound: by jets, wheels, control moment gyros, and a free swing.

    python benchmarks/pedestal.py --seeds 50

Each seed is a random table of its own (``tests/anypedestal.py``, an integrator without code in common with the estimator). The bound is of
its own flight, by differences: the same actuators' motion once for each of the nine values, and each rate at the start, a little larger and
once a little smaller. Of a free swing inertia is known to a hundredth of its size, and that is in the bound.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from scores import covered, rms_of
from script import counted

sys.path.insert(0, str(Path(__file__).parents[1]))
from massprop_cli import ABOUT_PIVOT, INERTIA, flow
from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import anypedestal

PERIOD_S, DURATION_S = 0.05, 30.0
KNOWN = 0.01
"""One sigma of the inertia of a table that swings, relative to a third of its trace."""
UNKNOWNS, RATE_STEP = 12, 1e-7


class Alike:
    """A generator that draws the same for all copies of one table, whose rates at the start differ by ``rates``."""

    def __init__(self, seed: int, rates: Array) -> None:
        self.own, self.rates, self.normals = np.random.default_rng(seed), rates, 0
        anypedestal.tables(self.own, 1)

    def __getattr__(self, name: str) -> Callable[..., Array]:
        """Any other method that draws numbers; its last argument is the size."""

        def drawn(*arguments: Any) -> Array:
            *of, size = arguments
            once = tuple(1 if length == len(self.rates) else length for length in size)
            return np.broadcast_to(getattr(self.own, name)(*of, size=once), size)

        return drawn

    def normal(self, mean: float, sigma: float, size: tuple[int, ...]) -> Array:
        """Normal numbers; the second call draws the rates at the start."""
        self.normals += 1
        found: Array = self.__getattr__("normal")(mean, sigma, size)
        return found + (self.rates if self.normals == 2 else 0.0)


def bound(seed: int, own: anypedestal.Tables, kind: anypedestal.Kind) -> Array:
    """(9,) one sigma of the bound of one table's ``about_pivot``."""
    trace = np.trace(own.about_pivot[0])
    sizes = np.concatenate([np.full(6, 1e-6 * trace), np.full(3, 1e-7 * own.mass[0]), np.full(3, RATE_STEP)])
    moves = np.concatenate([np.zeros((1, UNKNOWNS)), np.diag(sizes), -np.diag(sizes)])
    best = anypedestal._best  # the first copy decides for all: the bound is of the commands that were given

    def of_the_first(drawn: Array, impulse: Array, motion: Any, y: Array) -> Array:
        return np.broadcast_to(best(drawn, impulse, motion, y)[:1], drawn.shape[1:])

    with mock.patch.object(anypedestal, "_best", of_the_first):
        alike: Any = Alike(seed, moves[:, 9:])
        flown = anypedestal.fly(alike, _moved(own, moves), kind, PERIOD_S, DURATION_S)
    gyro, accel = PERIOD_S * own.noise[0]
    rows = np.concatenate([flown.turned / gyro, flown.pushed / accel], 2).reshape(len(moves), -1)
    slopes = (rows[1 : 1 + UNKNOWNS] - rows[1 + UNKNOWNS :]) / 2  # by a step of each
    information = slopes @ slopes.T
    if kind == "swing":
        information[:6, :6] += np.eye(6) * (1e-6 * trace / (KNOWN * trace / 3)) ** 2
    found: Array = sizes[:9] * np.sqrt(np.diag(np.linalg.inv(information)))[:9]
    return found


def _moved(own: anypedestal.Tables, moves: Array) -> anypedestal.Tables:
    """Copies of a table, of which inertia about the pivot and first moment are moved by ``moves`` (V, 9 + 3)."""
    copies = len(moves)
    kept = {
        name: np.repeat(getattr(own, name), copies, 0) for name in ("mass", "pivot", "imu", "jet_position", "jet_force", "spin", "noise")
    }
    arm = np.repeat(own.arm, copies, 0) + moves[:, 6:9] / kept["mass"][:, None]
    upper = np.zeros((copies, 3, 3))
    upper[:, *np.triu_indices(3)] = moves[:, :6]
    own_inertia = own.about_pivot + upper + np.triu(upper, 1).swapaxes(1, 2)
    square = (arm**2).sum(1)[:, None, None] * np.eye(3) - arm[:, :, None] * arm[:, None, :]
    return anypedestal.Tables(inertia=own_inertia - kept["mass"][:, None, None] * square, cg=kept["pivot"] + arm, **kept)


class Told(NamedTuple):
    """(9,) errors, sigmas and bounds of ``about_pivot``."""

    error: Array
    sigma: Array
    bound: Array


def told(seed: int, kind: anypedestal.Kind) -> Told:
    """The outcome of one table."""
    rng = np.random.default_rng(seed)
    own = anypedestal.tables(rng, 1)
    flown = anypedestal.fly(rng, own, kind, PERIOD_S, DURATION_S)
    known: dict[str, Any] = {}
    if kind == "swing":
        size = KNOWN * float(np.trace(own.about_pivot[0])) / 3
        pairs = zip(INERTIA, own.nine[0], strict=False)
        known = {name: {"value": float(value + size * rng.normal()), "sigma": size} for name, value in pairs}
    used = anypedestal.vehicle_of(own, 0, flown, **known)
    (conclusion,) = flow.examine(anypedestal.log_of(rng, own, 0, flown, used), VehicleSource(used, "pedestal", "")).conclusions
    items = [conclusion.about_pivot[name] for name in ABOUT_PIVOT]
    value, sigma = (np.array([getattr(one, part) for one in items], dtype=float) for part in ("value", "sigma"))
    return Told(value - own.nine[0], sigma, bound(seed, own, kind))


def main() -> None:
    """Print one row for each kind of actuator."""
    asked = counted(__doc__, seeds=50, first=5000).parse_args()
    print("| by | rms error / bound | the same, from the least to the largest of nine values | sigma / bound, median | 95 % cover |")
    print("|---|--:|--:|--:|--:|")
    kinds: tuple[anypedestal.Kind, ...] = ("jets", "wheels", "gyros", "swing")
    for kind in kinds:
        error, sigma, limit = (np.array(part) for part in zip(*(told(asked.first + n, kind) for n in range(asked.seeds)), strict=True))
        each = np.sqrt(((error / limit) ** 2).mean(0))
        range_, over = f"{each.min():.2f} to {each.max():.2f}", f"{np.median(sigma / limit):.3f}"
        print(f"| {kind} | {rms_of(each)} | {range_} | {over} | {covered(error / sigma)} |", flush=True)


if __name__ == "__main__":
    main()
