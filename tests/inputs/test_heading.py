"""On a planar table an attitude may be logged as a heading alone."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns, telemetry
from massprop_cli.inputs.formats import mapfile, propose
from massprop_cli.inputs.tablefile import Table
from massprop_cli.inputs.vehiclefile import parse
from tests.streams import made, recording, values

ROWS, STEP_S = 400, 0.05
TURNED = 0.4 * gaussian_filter1d(np.random.default_rng(6).normal(size=ROWS + 1), 8).cumsum()  # more than a turn
FORCE = np.random.default_rng(7).normal(size=(ROWS, 2))
MAP = """
schema = 1
clock = { path = "t", unit = "s" }
[gyro]
paths = [0, 0, "wz"]
unit = "rad"
values = "increment"
[torque]
paths = [0, 0, 0]
[force]
paths = ["fx", "fy", 0]
unit = "N"
frame = "world"
[attitude]
paths = ["psi"]
order = "heading"
"""
VEHICLE = """
schema = 1
[cycle]
period_s = 0.05
[environment]
kind = "planar"
"""


def logged(more: str, heading: float = 1.0) -> Table:
    """A log whose heading is so many times the angle that the gyro turned."""
    t, psi = STEP_S * np.arange(1, ROWS + 1), heading * TURNED[1:]
    wrapped = (psi + np.pi) % (2 * np.pi) - np.pi if abs(heading) == 1 else psi
    streams = {"t": (t, "", ""), "wz": (np.diff(TURNED), "", ""), "psi": (wrapped, "", ""), "cmd": (t, "", "")}
    return made(streams | {f"f{axis}": (FORCE[:, n], "", "") for n, axis in enumerate("xy")}, MAP + more)


@pytest.mark.parametrize(
    ("more", "heading"),
    [
        ('unit = "rad"\n', 1.0),
        ('unit = "deg"\n', 180 / np.pi),
        ('unit = "deg"\nscale = 0.1\n', 1800 / np.pi),
        ('unit = "rad"\nturns = "body_from_world"\n', -1.0),
        ('unit = "rad"\nworld = "z_down"\naxes = ["x", "-y", "-z"]\n', -1.0),
    ],
)
def test_world_commands_are_turned_with_a_heading(more: str, heading: float) -> None:
    table = logged(more, heading)
    turns = Rotation.from_rotvec(TURNED[1:, None] * [0, 0, 1])
    world = np.column_stack([FORCE, np.zeros(ROWS)])
    # a heading about the vertical down is the other way round, and so are y and z of a body whose z is down
    body = turns.apply(world) * [1, -1, -1] if "z_down" in more else turns.inv().apply(world)
    np.testing.assert_allclose(values(table, columns.WRENCH[3:]), body, atol=1e-12)
    same = np.abs((values(table, columns.QUATERNION) * turns.as_quat()[:, [3, 0, 1, 2]]).sum(1))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)
    log = telemetry.read(table, parse(VEHICLE, "v").vehicle)
    assert log.attitude_wxyz is not None


def test_a_heading_is_the_attitude_of_a_planar_table_alone() -> None:
    table = logged('unit = "rad"\n')
    for kind in ("free", "air_bearing"):
        with pytest.raises(InputError, match=rf"m.toml is only a heading, .* environment.kind is \"{kind}\"; map quaternions, or state"):
            telemetry.read(table, parse(VEHICLE.replace("planar", kind), "v").vehicle)


def test_a_heading_in_another_unit_contradicts_the_gyro() -> None:
    with pytest.raises(
        InputError, match=r"the gyro turns by .* rad where the heading turns by .* is its unit right\? Correct \[attitude\]"
    ):
        telemetry.read(logged('unit = "deg"\n', 1.0001), parse(VEHICLE, "v").vehicle)
    with pytest.raises(InputError, match=r"logged attitude contradict each other .* the unit of a heading \(\[attitude\]\)"):
        telemetry.read(logged('unit = "rad"\n', 180 / np.pi), parse(VEHICLE, "v").vehicle)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("", r"'psi': the file records no unit; state unit = one of rad, deg"),
        ('unit = "rad"\nworld = "z_down"\n', r'a heading is about the world\'s z: state axes = \["x", "-y", "-z"\] with world = "z_down"'),
        ('unit = "rad"\naxes = ["x", "-y", "-z"]\n', r'state axes = z as the last of them with world = "z_up"'),
        ('unit = "rad"\nscale = 0\n', r"scale is zero"),
    ],
)
def test_a_heading_that_is_not_stated_whole_is_refused(more: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        logged(more)


def test_the_unit_of_a_quaternion_is_refused() -> None:
    text = MAP.replace('["psi"]\norder = "heading"', '"q?"\norder = "wxyz"\nunit = "rad"')
    with pytest.raises(InputError, match=r"unit and scale are of a heading alone; drop them, or state order = \"heading\""):
        mapfile.parse(text, "m.toml")


def test_a_draft_offers_it() -> None:
    text = propose.draft(recording({"t": (np.arange(5.0), "", "s"), "base/yaw": (np.arange(5.0), "t", "")}))
    assert '# paths = ["base/yaw"]\n' in text
    assert '# order = "heading"\n# unit = "?"   # rad or deg' in text
    assert '"heading"' not in propose.draft(recording({"t": (np.arange(5.0), "", "s"), "yaw_rate": (np.arange(5.0), "t", "")}))
