"""What a flight refuses: no refused call changes it, and none of what it takes stops it."""

import ctypes
from collections.abc import Callable

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.estimate.compiled import TOLD
from massprop_cli.estimate.kernelflight import DELAY_S, VALUES, Flight
from massprop_cli.export.resolve import Constants
from massprop_cli.kernel import kernel, pointer
from tests.live.test_gate import cycles, resolved

pytestmark = pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
OK, NOT_FINITE, TIME, LIMIT, ORDER = range(5)
"""enum mp_status of massprop.h"""
BINS = 5
"""Where a vehicle's table has them."""


class Memory:
    """A flight, call by call: statuses, and the bytes that it keeps."""

    def __init__(self, name: str) -> None:
        self.constants: Constants = resolved(name)
        self.flight = Flight(self.constants.commands, self.constants.legs[0].vehicle, self.constants.legs[0].rule)
        self.told, self.values = np.empty((2, TOLD)), np.empty((2, VALUES))

    def step(self, cycle: Array | None) -> int:
        """The status of one cycle, or of the end."""
        status, fed = ctypes.c_int(), np.zeros((0, 1)) if cycle is None else np.ascontiguousarray(cycle[None])
        counts = (ctypes.c_long(n) for n in fed.shape)
        outputs = pointer(self.told), pointer(self.values), ctypes.byref(status)
        self.flight.library.mp_host_flown(self.flight.memory, *counts, pointer(fed), ctypes.c_int(cycle is None), *outputs)
        return status.value

    def begin(self, edit: Callable[[Array, Array], None]) -> int:
        """The status of a begin with tables that are edited."""
        leg = self.constants.legs[0]
        commands, vehicle = self.constants.commands.copy(), leg.vehicle.copy()
        edit(commands, vehicle)
        return int(self.flight.library.mp_host_fly(self.flight.memory, pointer(commands), pointer(vehicle), pointer(leg.rule)))

    def phase(self, bins: float) -> int:
        """The status of a new phase."""
        leg = self.constants.legs[0]
        vehicle = leg.vehicle.copy()
        vehicle[BINS] = bins
        return int(self.flight.library.mp_host_phase(self.flight.memory, pointer(vehicle), pointer(leg.rule)))


def too_late(commands: Array, vehicle: Array) -> None:
    commands[DELAY_S] = 1e9


def too_coarse(commands: Array, vehicle: Array) -> None:
    vehicle[BINS] = 1


@pytest.mark.parametrize("edit", [too_late, too_coarse])
def test_after_a_begin_that_failed_nothing_is_flown_until_one_succeeds(edit: Callable[[Array, Array], None]) -> None:
    flight, fed = Memory("free-flyer"), cycles("free-flyer")
    assert [flight.step(cycle) for cycle in fed[:100]] == [OK] * 100
    assert flight.begin(edit) == LIMIT
    assert {flight.step(cycle) for cycle in fed[100:110]} == {ORDER}
    assert flight.step(None) == ORDER
    assert flight.begin(lambda commands, vehicle: None) == OK
    assert {flight.step(cycle) for cycle in fed} == {OK}
    clean = Memory("free-flyer")
    assert {clean.step(cycle) for cycle in fed} == {OK}
    assert np.array_equal(flight.values[0], clean.values[0])


def test_after_a_phase_that_could_not_begin_nothing_is_flown_until_one_does() -> None:
    flight, fed = Memory("free-flyer"), cycles("free-flyer")
    assert {flight.step(cycle) for cycle in fed[:100]} == {OK}
    bins = flight.constants.legs[0].vehicle[BINS]
    assert flight.phase(1.0) == LIMIT
    assert flight.step(fed[100]) == ORDER
    assert flight.phase(bins) == OK
    assert {flight.step(cycle) for cycle in fed[100:]} == {OK}
