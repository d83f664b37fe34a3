"""Tables on a pedestal whose ballast is moved as massprop says, with motion, weights and first moments that are made apart from it."""

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from massprop_cli import flow
from massprop_cli.balance import flow as balancing
from massprop_cli.balance.document import Balance
from massprop_cli.base import escape
from massprop_cli.base.arrays import Array
from massprop_cli.inputs.ballast import Ballast, BallastFile
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.result import build, schema
from massprop_cli.result.read import Recorded
from tests import anypedestal
from tests.anypedestal import Tables

MASS_SIGMA = 5e-4
"""Relative, of each ballast."""
SET_M = 2e-5
"""By which a slide is read wrongly, one sigma."""


class Weights(NamedTuple):
    """Of V tables, four ballasts each: sliding along x, y and z, and a tray."""

    mass: Array
    """(V, 3) kg, as they truly are."""
    place: Array
    """(V, 4, 3) m from O."""
    stated: list[dict[str, Any]]
    """A ballast file of each."""


def weights(rng: np.random.Generator, own: Tables) -> Weights:
    """Slides of 6 to 9 % of the table's mass each, over 0.1 m both ways, and a tray for a hundredth of it."""
    count, radius = len(own.mass), 0.13 * own.mass ** (1 / 3)
    nominal = own.mass[:, None] * rng.uniform(0.06, 0.09, (count, 3))
    mass = nominal * (1 + MASS_SIGMA * rng.normal(size=(count, 3)))
    place = own.pivot[:, None] + radius[:, None, None] * rng.uniform(-0.8, 0.8, (count, 4, 3))
    stated = []
    for v in range(count):
        slides = [
            {"name": name, "mass_kg": float(nominal[v, n]), "axis": np.eye(3)[n].tolist(), "position_m": place[v, n].tolist()}
            | {"travel_m": [-0.1, 0.1], "mass_sigma_kg": MASS_SIGMA * float(nominal[v, n]), "position_sigma_m": SET_M}
            for n, name in enumerate("xyz")
        ]
        tray = {"name": "tray", "position_m": place[v, 3].tolist(), "max_mass_kg": 0.01 * float(own.mass[v])}
        stated.append({"ballast": [*slides, tray]})
    return Weights(mass, place, stated)


def put(rng: np.random.Generator, own: Tables, held: Weights, change: Array) -> Tables:
    """The tables after changes (V, 4) of the ballasts, m or kg, each set as well as that is: sums over point masses."""
    set_to = change[:, :3] + SET_M * rng.normal(size=(len(change), 3)) * (change[:, :3] != 0)
    mass, cg, inertia = own.mass.copy(), own.cg.copy(), own.inertia.copy()
    for v in range(len(mass)):
        points = [(-m, at) for m, at in zip(held.mass[v], held.place[v], strict=False)]
        points += [(m, at + d * a) for m, at, d, a in zip(held.mass[v], held.place[v], set_to[v], np.eye(3), strict=False)]
        points += [(change[v, 3], held.place[v, 3])]
        whole = own.mass[v] + sum(m for m, _ in points)
        centre = (own.mass[v] * own.cg[v] + sum((m * at for m, at in points), np.zeros(3))) / whole
        about = own.inertia[v] + own.mass[v] * _square(own.cg[v] - centre)
        inertia[v] = about + sum((m * _square(at - centre) for m, at in points), np.zeros((3, 3)))
        mass[v], cg[v] = whole, centre
    return replace(own, mass=mass, cg=cg, inertia=inertia)


def _square(arm: Array) -> Array:
    found: Array = (arm @ arm) * np.eye(3) - np.outer(arm, arm)
    return found


def moments(own: Tables) -> Array:
    """(V, 3) the true first moments about the pivots, kg m."""
    found: Array = own.mass[:, None] * own.arm
    return found


def results(
    rng: np.random.Generator, own: Tables, kind: anypedestal.Kind, scale: Array | None = None, scale_sigma: float = 0.0
) -> list[Recorded]:
    """A log of each, estimated; the true thrust is ``scale`` (V,) times what the vehicle file states, to ``scale_sigma``."""
    pushed = own if scale is None else replace(own, jet_force=own.jet_force * scale[:, None, None])
    flown, found = anypedestal.fly(rng, pushed, kind, 0.1, 20.0), []
    for body in range(len(own.mass)):
        used = anypedestal.vehicle_of(own, body, flown)
        used = used.model_copy(update={"thrust": used.thrust.model_copy(update={"scale_sigma": scale_sigma})})
        log = anypedestal.log_of(rng, own, body, flown, used)
        told = build.result(flow.examine(log, VehicleSource(used, "", "")))
        made = told.provenance.model_copy(update={"input_sha256": f"{body} {rng.integers(1 << 60)}"})  # a log at hand has no digest
        whole = schema.Result.model_validate_json(escape.document(told.model_copy(update={"provenance": made})))
        found.append(Recorded(Path(f"table-{body}/result.json"), whole, {}))
    return found


def files(held: Weights) -> list[tuple[Ballast, ...]]:
    """The ballast of each table as it is stated."""
    return [BallastFile.model_validate(one).ballast for one in held.stated]


def balances(logs: list[Recorded], held: Weights, after: list[Recorded] | None = None) -> list[Balance]:
    """What massprop says to do with each; with ``after``, of what was done as it had said."""
    later: list[Recorded | None] = [*after] if after else [None] * len(logs)
    return [balancing.balance(one, own, None, None, other, ()) for one, own, other in zip(logs, files(held), later, strict=True)]


def changes(found: list[Balance]) -> Array:
    """(V, 4) m or kg."""
    return np.array([[(one.by_mm or 0.0) / 1000 + (one.add_kg or 0.0) for one in balance.plan.changes] for balance in found])


def moment(found: list[Balance], of: str) -> tuple[Array, Array]:
    """(V, 3) first moments and their sigmas, kg m: ``now``, or of the ``remainder``."""
    told = [(one.now if of == "now" else one.plan.remainder).moment for one in found]
    return np.array([one.kg_m for one in told]), np.array([one.sigma_kg_m for one in told])
