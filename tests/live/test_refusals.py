"""What a flight refuses: no refused call changes it, and none of what it takes stops it."""

import ctypes

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.estimate.compiled import ROW_SIZE
from massprop_cli.estimate.kernelflight import DELAY_S, VALUES, Flight
from massprop_cli.export import resolve
from massprop_cli.export.resolve import FlightConstants
from massprop_cli.inputs import vehiclefile
from massprop_cli.kernel import kernel, pointer
from tests.analysed import SAMPLES
from tests.live.test_gate import UNTOLD, cycles, resolved

pytestmark = pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
OK, NOT_FINITE, TIME, LIMIT, ORDER = range(5)
"""enum mp_status of massprop.h"""
BINS = 5
"""Where a vehicle's table has them."""
END, DURATION, THETA, VELOCITY, COMMAND = 0, 1, 2, 5, 11
"""Where a cycle's numbers begin."""


class Memory:
    """A flight, call by call: statuses, and the bytes that it keeps."""

    def __init__(self, name: str) -> None:
        self.constants: FlightConstants = resolved(name)
        self.flight = Flight(self.constants.commands, self.constants.phases[0].vehicle, self.constants.phases[0].rule)
        self.told, self.values = np.empty((2, ROW_SIZE)), np.empty((2, VALUES))

    def step(self, cycle: Array | None) -> int:
        """The status of one cycle, or of the end."""
        status, fed = ctypes.c_int(), np.zeros((0, 1)) if cycle is None else np.ascontiguousarray(cycle[None])
        counts = (ctypes.c_long(n) for n in fed.shape)
        outputs = pointer(self.told), pointer(self.values), ctypes.byref(status)
        self.flight.library.mp_host_flown(self.flight.memory, *counts, pointer(fed), ctypes.c_int(cycle is None), *outputs)
        return status.value

    def bytes(self) -> bytes:
        """All that it keeps."""
        return ctypes.string_at(self.flight.memory, self.flight.library.mp_host_flight_size())

    def begin(self, delay_s: float | None = None, bins: float | None = None) -> int:
        """The status of a begin, with another delay of the commands or another number of bins."""
        phase = self.constants.phases[0]
        commands, vehicle = self.constants.commands.copy(), phase.vehicle.copy()
        commands[DELAY_S] = commands[DELAY_S] if delay_s is None else delay_s
        vehicle[BINS] = vehicle[BINS] if bins is None else bins
        return int(self.flight.library.mp_host_fly(self.flight.memory, pointer(commands), pointer(vehicle), pointer(phase.rule)))

    def phase(self, bins: float) -> int:
        """The status of a new phase."""
        phase = self.constants.phases[0]
        vehicle = phase.vehicle.copy()
        vehicle[BINS] = bins
        return int(self.flight.library.mp_host_phase(self.flight.memory, pointer(vehicle), pointer(phase.rule)))


@pytest.mark.parametrize("tables", [{"delay_s": 1e9}, {"bins": 1.0}])
def test_after_a_begin_that_failed_nothing_is_flown_until_one_succeeds(tables: dict[str, float]) -> None:
    flight, fed = Memory("free-flyer"), cycles("free-flyer")
    assert [flight.step(cycle) for cycle in fed[:100]] == [OK] * 100
    assert flight.begin(**tables) == LIMIT
    assert {flight.step(cycle) for cycle in fed[100:110]} == {ORDER}
    assert flight.step(None) == ORDER
    assert flight.begin() == OK
    assert {flight.step(cycle) for cycle in fed} == {OK}
    clean = Memory("free-flyer")
    assert {clean.step(cycle) for cycle in fed} == {OK}
    assert np.array_equal(flight.values[0], clean.values[0])


def test_after_a_phase_that_could_not_begin_nothing_is_flown_until_one_does() -> None:
    flight, fed = Memory("free-flyer"), cycles("free-flyer")
    assert {flight.step(cycle) for cycle in fed[:100]} == {OK}
    bins = flight.constants.phases[0].vehicle[BINS]
    assert flight.phase(1.0) == LIMIT
    assert flight.step(fed[100]) == ORDER
    assert flight.phase(bins) == OK
    assert {flight.step(cycle) for cycle in fed[100:]} == {OK}


REFUSED = (
    *((DURATION, value, TIME) for value in (4.9e-324, 1e-300, 1e-30, 1e-6, 0.0, -0.05, 1e300)),
    *((END, value, TIME) for value in (0.0, -1e300, 1e5, 1e30)),
    *((column, value, NOT_FINITE) for column in (END, DURATION, THETA, VELOCITY, COMMAND) for value in (np.nan, np.inf)),
    *((COMMAND, value, NOT_FINITE) for value in (-1e-300, 0.0501, 1e300)),
)
"""Of a cycle which number is what, and what is said of it."""


@pytest.mark.parametrize("name", ["free-flyer", "air-bearing"])
def test_a_cycle_that_is_refused_changes_nothing(name: str) -> None:
    """Neither a byte of the memory, nor a bit of what is said later."""
    fed = cycles(name)[:200]
    flight, clean = Memory(name), Memory(name)
    for k, cycle in enumerate(fed):
        if k > 0:
            column, value, status = REFUSED[k % len(REFUSED)]
            bad, before = cycle.copy(), flight.bytes()
            bad[column] = value
            assert (column, value, flight.step(bad)) == (column, value, status)
            assert flight.bytes() == before
        assert flight.step(cycle) == clean.step(cycle) == OK
    assert np.isfinite(clean.values[0, :10]).any()
    assert np.array_equal(flight.values[0], clean.values[0], equal_nan=True)


@pytest.mark.parametrize("name", ["free-flyer", "air-bearing"])
def test_whatever_finite_numbers_come_a_refused_call_changes_nothing(name: str) -> None:
    """Some are refused, others taken as readings that no vehicle moves by; what follows is flown in either case."""
    fed, random = cycles(name)[:300], np.random.default_rng(1)
    extremes = np.array([4.9e-324, 1e-308, -1e-300, 1e-30, 1e10, -1e100, 1e150, 1e200, -1e300, 1.7e308, 0.0, -0.0])
    flight, refused = Memory(name), 0
    for cycle in fed:
        bad = cycle.copy()
        columns = random.random(len(bad)) < np.where(np.arange(len(bad)) < COMMAND, 0.2, 0.01)
        bad[columns] = random.choice(extremes, columns.sum())
        before, status = flight.bytes(), flight.step(bad)
        assert status in (OK, NOT_FINITE, TIME)
        assert status == OK or flight.bytes() == before
        refused += status != OK
        assert status == OK or flight.step(cycle) == OK
    assert 30 < refused < 200


@pytest.mark.parametrize("seed", [1120, 1603])
def test_no_value_is_told_where_torques_that_no_vehicle_has_leave_no_number(seed: int) -> None:
    """Up to 9e8 N m and N, which are commands that the kernel takes."""
    constants = resolve.stated(vehiclefile.load(SAMPLES / "air-bearing" / "vehicle.toml", ["jets=[]"]))
    random, count = np.random.default_rng(seed), 120
    fed = np.zeros((count, COMMAND + 6))
    fed[:, END], fed[:, DURATION] = np.arange(1, count + 1) * 0.05, 0.05
    fed[:, THETA:8] = random.normal(0.0, 0.005, (count, 6))
    some = random.random((count, 6)) < random.choice([0.01, 0.03, 0.1, 0.3])
    fed[:, COMMAND:] = np.where(some, random.choice([9e8, -3e8, 1e4, -1e6, 1e2, 0.01, 5e-2, 1e-3, 0, 0], (count, 6)), 0)
    phase = constants.phases[0]
    found = Flight(constants.commands, phase.vehicle, phase.rule).step(fed, last=True)
    told = found.verdicts != UNTOLD
    assert np.isfinite(found.values[told]).all()
    assert np.isfinite(found.sigmas[told]).all()
