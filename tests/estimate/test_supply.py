"""Jets whose thrust follows the logged pressure of their supply, from a log that is written and read to its estimate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.inputs import telemetry, vehiclefile
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.supply import SupplyLevel
from massprop_cli.testbed import output, scenario, simulate
from tests import faulty
from tests.flown import fly

FALLING = ("vehicle.thrust.nominal_pa=2e6", "actuators.supply_pa=[2.1e6, 1.4e6]")
"""By a third of it within a log."""


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_pressure_that_falls_is_in_the_thrust() -> None:
    """Of two logs no value is off by chance of 1 in 10,000, and nothing is said; as if the thrust stayed the same its fall is."""
    flight = fly("free-flyer", *FALLING, seeds=(1, 2))
    z = []
    for member in range(2):
        found = faulty.examined(flight.log(member), flight.vehicle)
        assert found.notices == ()
        z += list(faulty.z_scores(found, flight.truth[member][0]).values())
    assert np.abs(z).max() < 4.3
    assert np.sqrt(np.square(z).mean()) < 1.7
    steady = flight.vehicle.model_copy(update={"thrust": flight.vehicle.thrust.model_copy(update={"nominal_pa": None})})
    wrong = faulty.examined(replace(flight.log(0), supply=None), steady)
    (said,) = [notice for notice in wrong.notices if "thrust falls" in notice.message]
    assert "thrust.nominal_pa" in said.message


def written(folder: Path, *settings: str) -> Path:
    """A short log."""
    short = ("duration_s=4.0", 'plan=[{motion="random", axes=["roll", "x"], start_s=0.0, end_s=4.0}]', "sensors.records_per_cycle=2")
    source = scenario.load("free-flyer", (*short, *FALLING, *settings))
    output.write(simulate.fly(source, (1,)), 0, source.scenario, folder, "csv")
    return folder / "log.csv"


def read(log: Path) -> telemetry.Log:
    return telemetry.read(read_table(log), vehiclefile.load(log.parent / "vehicle.toml").vehicle)


def test_a_log_has_the_mean_pressure_of_each_cycle_over_the_stated_one(tmp_path: Path) -> None:
    supply = read(written(tmp_path)).supply
    assert isinstance(supply, SupplyLevel)
    np.testing.assert_allclose(supply.time_s, 0.05 * np.arange(80) + 0.025, atol=1e-9)
    np.testing.assert_allclose(supply.part, np.interp(supply.time_s, [0.0, 4.0], [1.05, 0.7]), atol=1e-9)
    assert supply.at(np.array([-1.0, 9.0])) == pytest.approx([supply.part[0], supply.part[-1]])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("supply_pa", "tank_pa", ("column 'supply_pa' is missing", "leave thrust.nominal_pa out")),
        ("2089062.5", "20.890625", ("log.csv, line 4, column supply_pa", "20.8906 Pa is 1e-05 of thrust.nominal_pa = 2e+06", "pascals")),
    ],
)
def test_a_pressure_that_is_none_is_refused_with_what_to_do(old: str, new: str, words: tuple[str, ...], tmp_path: Path) -> None:
    log = written(tmp_path)
    text = log.read_text()
    assert old in text
    log.write_text(text.replace(old, new))
    with pytest.raises(InputError) as refused:
        read(log)
    assert all(word in str(refused.value) for word in words), refused.value


def test_a_pressure_without_jets_is_refused() -> None:
    with pytest.raises(InputError, match=r"thrust\.nominal_pa is the supply pressure of jets, but there are no"):
        vehiclefile.parse("schema = 1\ncycle = {period_s = 0.05, command_delay_cycles = 1.0}\nthrust = {nominal_pa = 2e6}\n", "v.toml")
