"""Linearisation of the response about one reference, in the mass properties (:mod:`massprop_cli.model.regressors`).

Its state x stands as :mod:`massprop_cli.model.layout` has it.
"""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import times
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.layout import PARAMETERS, RATE, Layout
from massprop_cli.model.parameters import parameters
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.regressors import Steps, regressors
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.prepare.compensate import Source


@dataclass(frozen=True)
class Linear(Steps):
    """A linear system about one reference."""

    drive: Array
    """(K − 1, n)"""
    measured: Array
    """(K, 6)"""
    felt: Array
    """(K, 3) the specific force of these at the measured rates: what mass properties and nuisances explain."""


def linearise(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle) -> Linear:
    """The linear system of ``cycles`` (a slice with both ends given) about ``reference``. Row k uses data of cycles k and before only."""
    phi_map, layout = ResponseMap(plant_of(vehicle)), Layout.of(samples, vehicle)
    theta = phi_map.plant.theta(reference)
    phi, slopes = phi_map.coefficients(theta)
    by_parameter = slopes @ np.linalg.inv(phi_map.plant.slopes(theta))
    about = phi - by_parameter @ parameters(reference)
    free = regressors(samples, cycles, reference, vehicle, np.column_stack([about, by_parameter]))
    states = slice(RATE.start, None)
    transition = np.zeros((len(free.drive), layout.size, layout.size))
    transition[:, PARAMETERS, PARAMETERS] = np.eye(10)
    transition[:, states, states] = free.transition
    transition[:, RATE, PARAMETERS] = free.drive[:, :3, 2:]
    drive = np.zeros((len(free.drive), layout.size))
    drive[:, states] = free.drive[..., 0] + free.drive[..., 1]
    observation = np.zeros((len(free.measured), 6, layout.size))
    observation[..., states] = free.observation
    observation[:, 3:, PARAMETERS] = -free.measured[:, 3:, 2:]
    measured = free.measured[..., 0] + free.measured[..., 1]
    rate = samples.part(cycles).rate_rad_s - reference.gyro_bias
    felt = measured[:, 3:] - times(observation[:, 3:, RATE], rate)
    return Linear(transition, observation, free.moment_to_rate, free.steps, drive, measured, felt)


def less_tilt(system: Linear, left: Array, tilt: slice) -> Array:
    """(K, 3) specific force ``left`` over by the mass properties, without what the states ``tilt`` of an unknown beginning explain of it.

    Where an error of the rate leaves them alone: what a table holds of the weight's pull along its slope.
    """
    carried = np.empty((len(left), 3, tilt.stop - tilt.start))
    state: Array = np.eye(tilt.stop - tilt.start)
    for k, seen in enumerate(system.observation[:, 3:, tilt]):
        carried[k] = seen @ state
        state = state if k == len(left) - 1 else system.transition[k, tilt, tilt] @ state
    rows = np.concatenate([carried, system.observation[: len(left), 3:, PARAMETERS]], -1).reshape(-1, carried.shape[2] + 10)
    size = np.sqrt((rows**2).sum(0))
    size = np.where(size > 0, size, 1.0)
    held = np.linalg.lstsq(rows / size, left.ravel(), rcond=1e-9)[0] / size
    return left - carried @ held[: carried.shape[2]]
