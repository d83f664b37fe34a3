"""Linear system of the response about one reference, with the mass properties as states (:mod:`massprop_cli.model.layout`)."""

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
    """A linear system of K cycles about one reference; n states, mass properties included."""

    drive: Array
    """(K − 1, n) drive."""
    measured: Array
    """(K, 6) measured rate and specific force."""
    specific_force: Array
    """(K, 3) specific force that mass properties and nuisance states must explain, at the measured rates, m/s²."""


def linearise(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle) -> Linear:
    """The linear system of ``cycles`` (a slice with both ends) about ``reference``. Row k uses data up to cycle k only."""
    phi_map, layout = ResponseMap(plant_of(vehicle)), Layout.of(samples, vehicle)
    theta = phi_map.plant.theta(reference)
    phi, slopes = phi_map.coefficients(theta)
    by_parameter = slopes @ np.linalg.inv(phi_map.plant.slopes(theta))
    constant = phi - by_parameter @ parameters(reference)
    response = regressors(samples, cycles, reference, vehicle, np.column_stack([constant, by_parameter]))
    states = slice(RATE.start, None)
    transition = np.zeros((len(response.drive), layout.size, layout.size))
    transition[:, PARAMETERS, PARAMETERS] = np.eye(10)
    transition[:, states, states] = response.transition
    transition[:, RATE, PARAMETERS] = response.drive[:, :3, 2:]
    drive = np.zeros((len(response.drive), layout.size))
    drive[:, states] = response.drive[..., 0] + response.drive[..., 1]
    observation = np.zeros((len(response.measured), 6, layout.size))
    observation[..., states] = response.observation
    observation[:, 3:, PARAMETERS] = -response.measured[:, 3:, 2:]
    measured = response.measured[..., 0] + response.measured[..., 1]
    rate = samples.part(cycles).rate_rad_s - reference.gyro_bias
    specific_force = measured[:, 3:] - times(observation[:, 3:, RATE], rate)
    return Linear(transition, observation, response.moment_to_rate, response.steps, drive, measured, specific_force)


def without_tilt(system: Linear, residual: Array, tilt: slice) -> Array:
    """(K, 3) residual of specific force without the part that the ``tilt`` states explain by least squares.

    The initial tilt is unknown. Mass properties are fitted at the same time, so that tilt explains only what they cannot. Requires that
    a rate error does not drive the tilt states: true of a table's slope.
    """
    by_initial = np.empty((len(residual), 3, tilt.stop - tilt.start))
    state: Array = np.eye(tilt.stop - tilt.start)
    for k, jacobian in enumerate(system.observation[:, 3:, tilt]):
        by_initial[k] = jacobian @ state
        state = state if k == len(residual) - 1 else system.transition[k, tilt, tilt] @ state
    rows = np.concatenate([by_initial, system.observation[: len(residual), 3:, PARAMETERS]], -1).reshape(-1, by_initial.shape[2] + 10)
    size = np.sqrt((rows**2).sum(0))
    size = np.where(size > 0, size, 1.0)
    fit = np.linalg.lstsq(rows / size, residual.ravel(), rcond=1e-9)[0] / size
    return residual - by_initial @ fit[: by_initial.shape[2]]
