"""What one sigma of uncertain geometry does, against the same log read with a vehicle that has it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.rigidbody import tensor
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.inputs.equipment import Jet
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.assumptioncolumns import assumption_columns
from massprop_cli.model.geometry import uncertain_jets
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.regressors import regressors
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider, OtherReading, Variant, with_geometry
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing
from tests import faulty
from tests.flown import fly

pytestmark = pytest.mark.numerical

CYCLES = slice(50, 350)
STEP = 1e-4
SHORTER = {"planar": ("duration_s=18.0", 'plan=[{motion="random", axes=["x", "y", "yaw"], start_s=0.0, end_s=18.0}]')}


def flown(name: str) -> tuple[Log, Vehicle, Reference]:
    """A sample, or what is flown of a scenario of which there is none."""
    if name == "free-flyer":
        (log, vehicle), true = faulty.sample(name), faulty.truth(name)
    else:
        found = fly(name, *SHORTER.get(name, ()), seeds=(1,))
        log, vehicle, true = found.log(0), found.vehicle, found.truth[0, 0]
    return log, vehicle, Reference(tensor(true[:6]), true[6:9], 1 / true[9])


def changed(vehicle: Vehicle, number: int, jet: Jet) -> Vehicle:
    jets = tuple(jet if i == number else other for i, other in enumerate(vehicle.jets))
    return Vehicle.model_validate(vehicle.model_copy(update={"jets": jets}).model_dump(by_alias=True))


@pytest.mark.parametrize(("name", "apart"), [("free-flyer", 0.01), ("planar", 0.001), ("testbed", 0.04)])
def test_a_jets_columns_are_what_the_changed_jet_does(name: str, apart: float) -> None:
    """In free flight but for what the change does to the motion within a cycle; on the bearing with the level of its middle."""
    log, vehicle, reference = flown(name)
    timing = Timing(float(vehicle.cycle.command_delay_cycles), 0.0)
    samples = Stream.of(log, vehicle, timing)
    number = int(np.argmax(log.command[CYCLES].sum(0)))
    jet = vehicle.jets[number]
    sigmas = {"thrust_sigma": STEP, "position_sigma_m": STEP, "direction_sigma_rad": STEP}
    uncertain = changed(vehicle, number, jet.model_copy(update=sigmas))
    jets = uncertain_jets(uncertain)
    assert set(jets.channels) == {number}
    variants = []
    for change in jets.wrench:
        # the place that gives this torque: what is across the force
        force = np.array(jet.force_n) + change[3:]
        place = np.array(jet.position_m) + np.cross(force, change[:3] - np.cross(jet.position_m, change[3:])) / (force @ force)
        other = changed(vehicle, number, jet.model_copy(update={"force_n": tuple(force.tolist()), "position_m": tuple(place.tolist())}))
        variants.append(Variant(OtherReading(samples), OtherReading(Stream.of(log, other, timing), other), 1.0))
    here, phi_map = regressors(samples, CYCLES, reference, vehicle), ResponseMap(plant_of(vehicle))
    by_columns = assumption_columns(here, samples, CYCLES, reference, vehicle, Consider(jets=jets), phi_map)
    by_reading = assumption_columns(here, samples, CYCLES, reference, vehicle, Consider(tuple(variants)), phi_map)
    for found, expected in zip(*([each[..., 1:] for each in one] for one in (by_columns, by_reading)), strict=True):
        for g in range(len(jets.kinds)):
            size = np.abs(expected[..., g]).max()
            if jets.kinds[g] != "jet-position" or name != "planar":
                assert size > 0
            np.testing.assert_allclose(found[..., g], expected[..., g], atol=max(apart * size, 1e-9))


def test_a_place_along_the_jet_is_nothing_and_on_a_table_neither_is_what_it_takes_up() -> None:
    jet = Jet(name="x", position_m=(0.0, 0.2, 0.1), force_n=(1.0, 0.0, 0.0), position_sigma_m=0.01)
    vehicle = Vehicle.model_validate({"schema": 1, "cycle": {"period_s": 0.05}, "jets": [jet.model_dump()]})
    found = uncertain_jets(vehicle)
    np.testing.assert_allclose(np.abs(found.wrench).sum(0), [0.0, 0.01, 0.01, 0.0, 0.0, 0.0], atol=1e-15)
    table = vehicle.model_copy(update={"environment": vehicle.environment.model_copy(update={"kind": "planar"})})
    np.testing.assert_allclose(np.abs(uncertain_jets(table).wrench), [[0.0, 0.0, 0.01, 0.0, 0.0, 0.0]], atol=1e-15)


def test_what_is_not_uncertain_has_no_column() -> None:
    log, vehicle, _ = flown("planar")
    samples = Stream.of(log, vehicle, Timing(1.0, 0.0))
    assert with_geometry(Consider(), Setup(log, vehicle, Timing(1.0, 0.0)), samples).kinds == ()
    imu = vehicle.imu.model_copy(update={"position_sigma_m": 1e-3})
    only = with_geometry(Consider(), Setup(log, vehicle.model_copy(update={"imu": imu}), Timing(1.0, 0.0)), samples)
    assert only.kinds == ("imu-position",) * 3
    assert replace(only, imu=()).kinds == ()
