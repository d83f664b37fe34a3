"""What a vehicle file may state of a fixed pedestal, and what is refused with its remedy."""

from typing import Any

import pytest
from pydantic import ValidationError

from massprop_cli.inputs.vehicle import Vehicle


def stated(environment: dict[str, Any], **more: Any) -> Vehicle:
    return Vehicle.model_validate({"schema": 1, "cycle": {"period_s": 0.05}, "environment": environment, **more})


@pytest.mark.parametrize(
    ("environment", "more", "named"),
    [
        ({"kind": "pedestal", "bearing_mass_kg": 3.0}, {}, ["bearing_mass_kg = 3", "fixed pedestal", 'kind = "air_bearing"']),
        ({"kind": "pedestal", "gravity_m_s2": 0.0}, {}, ['kind = "pedestal"', "gravity_m_s2 = 0"]),
        ({"kind": "pedestal"}, {"estimator": {"method": "thesis"}}, ["thesis", "pedestal"]),
        ({"kind": "air_bearing", "bearing_mass_kg": 1e9}, {}, ["bearing_mass_kg = 1e+09", 'kind = "pedestal"', "1e+07 kg"]),
        (
            {"kind": "air_bearing", "bearing_mass_kg": 2e4},
            {"known": {"mass": {"value": 12.0, "sigma": 0.1}}},
            ["1000 times the vehicle's 12 kg", 'kind = "pedestal"'],
        ),
        ({"kind": "air_bearing", "bearing_mass_kg": 2e4}, {"nominal": {"mass": 20010.0}}, ["the vehicle's 10 kg", 'kind = "pedestal"']),
    ],
)
def test_what_has_no_part_in_the_motion_is_refused(environment: dict[str, Any], more: dict[str, Any], named: list[str]) -> None:
    with pytest.raises(ValidationError) as refused:
        stated(environment, **more)
    for part in named:
        assert part in str(refused.value)


def test_a_pedestal_turns_under_gravity_and_has_no_bearing_mass() -> None:
    pedestal, bearing = stated({"kind": "pedestal"}), stated({"kind": "air_bearing", "bearing_mass_kg": 5.0}, nominal={"mass": 20.0})
    assert (pedestal.pivoted, pedestal.on_pedestal, pedestal.on_air_bearing) == (True, True, False)
    assert (bearing.pivoted, bearing.on_pedestal, bearing.on_air_bearing) == (True, False, True)
    assert pedestal.bearing_mass_kg == 0
    assert bearing.bearing_mass_kg == 5
