"""A test vector: a log's cycles as they were flown, and every value and sigma that the kernel gives here, by their bits."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.estimate import flown
from massprop_cli.export.resolve import Constants, Leg
from massprop_cli.inputs.telemetry import Log


def given(resolved: Constants, log: Log) -> str:
    """vector.txt: of each phase its number and how many cycles, then a line of hexadecimal numbers for each cycle."""
    lines = []
    for number, leg in enumerate(resolved.legs):
        fed = _cycles(leg, log)
        lines.append(f"{number} {len(fed)}")
        lines += [" ".join(value.hex() for value in row) for row in fed.tolist()]
    return "\n".join(lines) + "\n"


def expected(resolved: Constants, log: Log) -> str:
    """expected.txt: a line for each cycle that is estimated from: values and sigmas by their bits, and verdicts' numbers."""
    return "".join(line for leg in resolved.legs for line in _told(resolved, leg, log))


def _told(resolved: Constants, leg: Leg, log: Log) -> Iterator[str]:
    flight = flown.Flight(resolved.commands, leg.vehicle, leg.rule)
    found = flight.step(_cycles(leg, log), last=True)
    for value, sigma, verdict in zip(found.values, found.sigmas, found.verdicts, strict=True):
        yield " ".join([*map(bits, [*value, *sigma]), *(str(int(v)) for v in verdict)]) + "\n"


def bits(value: float) -> str:
    """A number's bits in hexadecimal, or a dash where nothing is told."""
    return "-" if np.isnan(value) else struct.pack(">d", value).hex()


def _cycles(leg: Leg, log: Log) -> Array:
    """From the log's first cycle on, since commands in flight and the attitude go on."""
    return flown.cycles_of(log, slice(0, min(leg.cycles.stop + 1, log.cycles)), leg.cycles)
