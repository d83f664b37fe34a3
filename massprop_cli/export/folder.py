"""Folder of the flight code: the kernel's sources, the vehicle's tables, a test vector, a Makefile and a README."""

import struct
from pathlib import Path
from typing import Any

import numpy as np

from massprop_cli import __version__
from massprop_cli import kernel as kernel_room
from massprop_cli.base import files
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.base.escape import line
from massprop_cli.base.lazy import jinja2
from massprop_cli.estimate import kernelflight
from massprop_cli.export import tables
from massprop_cli.export.resolve import FlightConstants, PhaseConstants
from massprop_cli.inputs.telemetry import Log
from massprop_cli.kernel import kernel

SOURCES = Path(kernel_room.__file__).parent
TEMPLATES = Path(__file__).parent
HOST = (
    *("attitude.c", "blocks.c", "comparison.c", "host.c", "host.h", "hypothesis.c", "hypothesis.h"),
    *("initialbody.c", "offline.c", "signals.c"),
)
"""Sources that the flight code does not need."""


def write(constants: FlightConstants, folder: Path) -> list[str]:
    """Write the folder and return the file names; the folder receives all files or none."""
    texts = contents(constants)
    files.check_own(folder, texts, "table.h")
    with files.staged(folder) as stage:
        for name, text in texts.items():
            stage.save(name, text)
        stage.place()
        for name in {"vector.txt", "expected.txt"} - texts.keys():  # they are from an earlier export
            (folder / name).unlink(missing_ok=True)
    return list(texts)


def contents(constants: FlightConstants) -> dict[str, str]:
    """Text of each file, by name; raise :class:`InputError` if a test vector needs the compiled kernel and there is none."""
    sources = sorted(path for path in SOURCES.iterdir() if path.suffix in (".c", ".h") and path.name not in HOST)
    texts = {path.name: path.read_text(encoding="utf-8") for path in sources}
    texts |= {"replay.c": (TEMPLATES / "replay.c").read_text(encoding="utf-8")}
    texts |= {"table.h": tables.header(constants), "table.c": tables.source(constants)}
    if constants.log is not None:
        if kernel().library is None:
            raise InputError(
                f"{constants.log.path}: a test vector needs the compiled kernel, but this machine runs {kernel().name}; install a C "
                "compiler and massprop again, or leave the log out",
                option="log",
            )
        texts |= {"vector.txt": inputs(constants, constants.log), "expected.txt": expected(constants, constants.log)}
    names = " ".join(path.name for path in sources if path.suffix == ".c")
    content = {**_readme_values(constants), "limits": tables.limits(constants), "sources": names, "log": constants.log is not None}
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), undefined=jinja2.StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    rendered = {"README.md": "README.in", "Makefile": "Makefile.in"}
    return texts | {name: templates.get_template(source).render(content) for name, source in rendered.items()}


def _readme_values(constants: FlightConstants) -> dict[str, Any]:
    """Values for the README's template."""
    jets, records, waits, delay_s = constants.commands[[0, kernelflight.RECORDS, kernelflight.WAITS, kernelflight.DELAY_S]].tolist()
    return {
        "name": line(" ".join(constants.vehicle.name.split())),
        "version": __version__,
        "vehicle": constants.vehicle,
        "inertia": "ixx ixy ixz iyy iyz izz [kg m^2]",
        "jets": jets,
        "records": records,
        "waits": waits,
        "delay_s": delay_s,
    }


def inputs(constants: FlightConstants, log: Log) -> str:
    """Text of vector.txt: for each phase its number and number of cycles, then one line of hexadecimal numbers per cycle."""
    lines = []
    for number, phase in enumerate(constants.phases):
        cycles = _cycles(phase, log)
        lines.append(f"{number} {len(cycles)}")
        lines += [" ".join(value.hex() for value in row) for row in cycles.tolist()]
    return "\n".join(lines) + "\n"


def expected(constants: FlightConstants, log: Log) -> str:
    """Text of expected.txt: one line per estimated cycle with the bits of values and sigmas, and the numbers of the verdicts."""
    lines = []
    for phase in constants.phases:
        reported = kernelflight.Flight(constants.commands, phase.vehicle, phase.rule).step(_cycles(phase, log), last=True)
        for value, sigma, verdict in zip(reported.values, reported.sigmas, reported.verdicts, strict=True):
            lines.append(" ".join([*map(bits, [*value, *sigma]), *(str(int(v)) for v in verdict)]) + "\n")
    return "".join(lines)


def bits(value: float) -> str:
    """Bits of a number in hexadecimal; a dash for NaN."""
    return "-" if np.isnan(value) else struct.pack(">d", value).hex()


def _cycles(phase: PhaseConstants, log: Log) -> Array:
    """Kernel inputs of all cycles up to the end of a phase: delayed commands and attitude depend on the earlier cycles."""
    return kernelflight.cycles_of(log, slice(0, min(phase.cycles.stop + 1, log.cycles)), phase.cycles)
