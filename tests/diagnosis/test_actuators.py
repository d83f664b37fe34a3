"""Wheels, control moment gyros and rotors that are not as stated are named, and what they are is estimated."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import rotation
from massprop_cli.diagnosis import comparison, explanation
from massprop_cli.diagnosis.channelwise import free_response
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.comparison import _LeastSquares
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.refit import Refit
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.kernel import kernel
from massprop_cli.prepare.timing import Timing
from massprop_cli.testbed import scenario
from tests import anypedestal, flight
from tests import flown as packaged
from tests.faultyactuators import FAULTS, Subject, examination, flown
from tests.testbed.test_rotors import rotors

NOISE = np.repeat([1e-4, 0.02], 3) ** 2
KINDS = [
    ("wheels", "rpm"),
    ("pedestal, wheels", "sign"),
    ("gyros", "dead"),
    ("gyros", "axis"),
    ("gyros", "axes"),
    ("rotors", "spin"),
    ("rotors", "spins"),
    ("gyros", "one in degrees"),
]
"""One of each code: `python benchmarks/actuator_faults.py` has every fault on every platform (docs/actuators.md)."""


@pytest.mark.numerical
@pytest.mark.skipif(kernel().library is None, reason="no compiled kernel was built")
@pytest.mark.parametrize("platform", ["gyros", "pedestal, wheels"])
def test_the_kernel_makes_of_stored_momentum_what_numpy_makes(platform: str, monkeypatch: pytest.MonkeyPatch) -> None:
    of = flown(platform, "none", cycles=200)
    used = Vehicle.model_validate(of.stated)
    free = free_response(
        Case(anypedestal.log_of(np.random.default_rng(0), of.own, 0, of.flown, used), flight.resolved(used), Timing(0.0, 0.0)),
        slice(2, 190),
    )
    model, rng = Model.of(free, used, 0.0, "jets"), np.random.default_rng(1)
    x = np.repeat(model.stated[None] + rng.normal(0.0, 0.05, len(model.stated)), 2, 0)
    x[:, :10] = [1.0, 0.1, 0.2, 2.0, 0.1, 1.5, 0.1, -0.05, 0.02, 0.05]
    turns = np.eye(3), rotation(np.array([0.3, 0.1, -0.2]))
    own = [Hypothesis("", (), np.eye(len(model.stated)), gyro=turn, accelerometer=turn, suspects=(1,)) for turn in turns]
    rows = _LeastSquares.of_all(model, free, NOISE, own)
    left, (begun, _) = rows.residuals(x), rows.initial(own)
    monkeypatch.setattr(comparison, "compiled", lambda: False)
    np.testing.assert_allclose(left, rows.residuals(x), rtol=1e-9, atol=1e-9 * np.abs(left).max())
    np.testing.assert_allclose(begun, replace(rows, regressions={}).initial(own)[0], rtol=1e-6, atol=1e-9)


def wrong(of: Subject, seed: int) -> tuple[set[str], Array, Array]:
    """Codes; deviations in sigmas of what is called converged, and of what the corrected estimate gives."""
    answer = examination(of, np.random.default_rng([seed, 0, 3]))
    z = []
    for conclusions in (answer.conclusions, *(one.conclusions for one in answer.mended)):
        items = conclusions[0].about_pivot if answer.vehicle.on_pedestal else conclusions[0].estimates
        told = [(one.value or 0.0, one.sigma, of.truth[name]) for name, one in items.items() if one.verdict == "converged"]
        z.append(np.array([abs((value - truth) / sigma) for value, sigma, truth in told if sigma]))
    return {notice.code for notice in answer.notices}, z[0], np.concatenate(z[1:]) if z[1:] else np.zeros(0)


@pytest.mark.parametrize(
    ("platform", "name"),
    [
        ("wheels", "swapped"),
        ("pedestal, wheels", "axes"),
        pytest.param("rotors", "percent", marks=[pytest.mark.thorough, pytest.mark.seeds]),
    ],
)
def test_a_fault_is_named_and_its_correction_gives_the_truth(platform: str, name: str) -> None:
    named(platform, name, 0, 300)


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize(("platform", "name"), KINDS)
def test_a_fault_of_each_code_is_named(platform: str, name: str) -> None:
    named(platform, name, 0, 400)


@pytest.mark.seeds
@pytest.mark.thorough
def test_gimbal_angles_in_degrees_are_named() -> None:
    """Those that turn so slowly that the log can be read."""
    named("gyros", "degrees", 1, 300)


def named(platform: str, name: str, seed: int, cycles: int) -> None:
    codes, now, corrected = wrong(flown(platform, name, seed, cycles), seed)
    assert codes & set(FAULTS[name].codes)
    assert now.max(initial=0.0) < 4
    assert len(corrected) > 5
    assert corrected.max() < 4.5


SPEEDS = (
    rotors(column='"speed"', spin_inertia_kg_m2="3e-5"),
    "actuators={max_rotor_command=1000.0, hover_force_n=[0, 0, 15.7], lag_s=0.04}",
    'plan=[{motion="hold", start_s=0, end_s=1}, {motion="random", axes=["roll", "pitch", "yaw", "z"], level=0.2, every_cycles=32, '
    "max_cycles=24, closed_loop=true, start_s=1, end_s=9}]",
    *("duration_s=9", "vehicle.cycle.period_s=0.005", "vehicle.imu.gyro_noise_rad_s=4e-3", "vehicle.imu.accel_noise_m_s2=0.1"),
)
"""Of the scenario multicopter: speeds are logged, and rotors store momentum."""


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("others", [(2,), (0, 1, 2, 3)])
def test_a_rotor_that_turns_the_other_way_stores_momentum_the_other_way_too(others: tuple[int, ...]) -> None:
    """With its drag alone turned no cause was named, and nothing converged."""
    of_rotors = packaged.fly("multicopter", *SPEEDS, seeds=(3,))
    stated = [one.model_copy(update={"spin": -one.spin if i in others else one.spin}) for i, one in enumerate(of_rotors.vehicle.rotors)]
    answer = flow.examine(of_rotors.log(0), VehicleSource(of_rotors.vehicle.model_copy(update={"rotors": tuple(stated)}), "t", ""))
    (mended,) = answer.mended
    assert mended.settings == tuple(f"rotors.{i}.spin={of_rotors.vehicle.rotors[i].spin}" for i in others)
    assert "rotor-spin" in {notice.code for notice in answer.notices}
    told = mended.conclusions[0]
    assert np.abs((told.values - of_rotors.truth[0, 0]) / told.sigmas).max() < 4.0


WRENCH = ("vehicle.jets=[]", "actuators.max_torque_n_m=[0.3,0.3,0.3]", "actuators.max_force_n=[1.3,1.3,1.3]")
"""Of the scenario wheels-and-jets: torque and force are commanded in place of jets."""


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_wheel_beside_a_commanded_wrench_is_corrected_by_itself() -> None:
    """The torque's column about its axis had been scaled along with it, and all ten values were up to 700 sigma off."""
    of_wrench = packaged.fly("wheels-and-jets", *WRENCH, seeds=(3,))
    wheels = [
        wheel.model_copy(update={"spin_inertia_kg_m2": part * wheel.spin_inertia_kg_m2})
        for wheel, part in zip(of_wrench.vehicle.wheels, (1.0, 0.9, 1.0), strict=True)
    ]
    answer = flow.examine(of_wrench.log(0), VehicleSource(of_wrench.vehicle.model_copy(update={"wheels": tuple(wheels)}), "t", ""))
    (mended,) = answer.mended
    assert [setting.split("=")[0] for setting in mended.settings] == ["wheels.1.spin_inertia_kg_m2", "uncertain"]
    told = mended.conclusions[0]
    assert np.abs((told.values - of_wrench.truth[0, 0]) / told.sigmas).max() < 4.0


@pytest.mark.seeds
@pytest.mark.thorough
def test_stored_momentum_in_proportion_is_a_rival_of_all_thrust_beside_a_weak_jet_too() -> None:
    """Of wheels that are stated too light; inertia had been corrected by the thrust alone, and converged 3000 sigma off."""
    of_jets = packaged.fly("wheels-and-jets", seeds=(3,))
    wheels = [wheel.model_copy(update={"spin_inertia_kg_m2": 0.9 * wheel.spin_inertia_kg_m2}) for wheel in of_jets.vehicle.wheels]
    jets = list(of_jets.vehicle.jets)
    jets[3] = jets[3].model_copy(update={"force_n": tuple(part / 0.8 for part in jets[3].force_n)})
    stated = of_jets.vehicle.model_copy(update={"wheels": tuple(wheels), "jets": tuple(jets)})
    answer = flow.examine(of_jets.log(0), VehicleSource(stated, "t", ""))
    said = " ".join(fault.notice.message for fault in answer.faults)
    assert "give +1.111 times the stated momentum, unlike the others" in said
    assert f"{jets[3].name} gives +0.7199 times" in said
    (mended,) = answer.mended
    told = mended.conclusions[0]
    assert np.abs((told.values - of_jets.truth[0, 0]) / told.sigmas).max() < 4.0


@pytest.mark.thorough
@pytest.mark.seeds
def test_torques_about_another_point_are_a_rival_beside_wheels_too() -> None:
    """An IMU out of place does nearly the same; named alone it left the CG converged thousands of sigmas off."""
    of_wrench = packaged.fly("wheels-and-jets", *WRENCH, "vehicle.imu.accel_noise_m_s2=2e-3", seeds=(3,))
    log = of_wrench.log(0)
    about = np.concatenate([log.command[:, :3] - np.cross([0.02, -0.01, 0.015], log.command[:, 3:]), log.command[:, 3:]], 1)
    answer = flow.examine(replace(log, command=about), VehicleSource(of_wrench.vehicle, "t", ""))
    assert "commanded torques are about" in " ".join([answer.unknown, *(fault.notice.message for fault in answer.faults)])
    told = answer.conclusions[0]
    wrong = np.abs((told.values - of_wrench.truth[0, 0]) / told.sigmas) > 4.0
    assert not any(one.verdict == "converged" for one, off in zip(told.estimates.values(), wrong, strict=True) if off)


@pytest.mark.parametrize(("factors", "told"), [((0.7, 0.7, 0.7, 0.7), True), ((0.7, 1.0, 1.0, 1.0), False)])
def test_all_rotors_may_store_more_where_they_may_give_less(factors: tuple[float, ...], told: bool) -> None:
    """A body with a part of its inertia turns alike: the thrust alone had been corrected, and all values were 900 sigma off."""
    begun = scenario.load("multicopter", ()).scenario.vehicle
    rotors = tuple(one.model_copy(update={"column": "speed", "spin_inertia_kg_m2": 1e-5 * (i + 1)}) for i, one in enumerate(begun.rotors))
    names = tuple(one.name for one, factor in zip(rotors, factors, strict=True) if factor != 1)
    part = SimpleNamespace(hypothesis=Hypothesis("thrust-scale", names, np.zeros((1, 0))))
    fitted, case = SimpleNamespace(parts=(part,), factors=np.array(factors)), SimpleNamespace(vehicle=SimpleNamespace(rotors=rotors))
    words, rivals = explanation._rotor_inertia(cast("Refit", SimpleNamespace(fitted=fitted, case=case)))
    assert words == (", or else they have 1.429 times the stated spin_inertia_kg_m2" if told else "")
    values = [setting for one in rivals for setting in one.settings]
    assert values == ([f"rotors.{i}.spin_inertia_kg_m2={1e-5 * (i + 1) / 0.7:.9g}" for i in range(4)] if told else [])
