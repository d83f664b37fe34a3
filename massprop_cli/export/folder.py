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
from massprop_cli.export.resolve import Constants, Leg
from massprop_cli.inputs.telemetry import Log
from massprop_cli.kernel import kernel

SOURCES = Path(kernel_room.__file__).parent
TEMPLATES = Path(__file__).parent
HOST = (
    *("attitude.c", "blocks.c", "comparison.c", "host.c", "host.h", "hypothesis.c", "hypothesis.h"),
    *("initialbody.c", "offline.c", "signals.c"),
)
"""Sources that the flight code does not need."""


def write(resolved: Constants, folder: Path) -> list[str]:
    """Write all files atomically; returns their names."""
    texts = contents(resolved)
    files.check_own(folder, texts, "table.h")
    with files.staged(folder) as stage:
        for name, text in texts.items():
            stage.save(name, text)
        stage.place()
        for name in {"vector.txt", "expected.txt"} - texts.keys():  # of an earlier export
            (folder / name).unlink(missing_ok=True)
    return list(texts)


def contents(resolved: Constants) -> dict[str, str]:
    """Text of each file, by name; :class:`InputError` if a test vector needs the compiled kernel and there is none."""
    sources = sorted(path for path in SOURCES.iterdir() if path.suffix in (".c", ".h") and path.name not in HOST)
    found = {path.name: path.read_text(encoding="utf-8") for path in sources}
    found |= {"replay.c": (TEMPLATES / "replay.c").read_text(encoding="utf-8")}
    found |= {"table.h": tables.header(resolved), "table.c": tables.source(resolved)}
    if resolved.log is not None:
        if kernel().library is None:
            raise InputError(
                f"{resolved.log.path}: a test vector needs the compiled kernel, but this machine runs {kernel().name}; install a C "
                "compiler and massprop again, or leave the log out",
                option="log",
            )
        found |= {"vector.txt": given(resolved, resolved.log), "expected.txt": expected(resolved, resolved.log)}
    names = " ".join(path.name for path in sources if path.suffix == ".c")
    content = {**_told(resolved), "limits": tables.limits(resolved), "sources": names, "log": resolved.log is not None}
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), undefined=jinja2.StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    made = {"README.md": "README.in", "Makefile": "Makefile.in"}
    return found | {name: templates.get_template(source).render(content) for name, source in made.items()}


def _told(resolved: Constants) -> dict[str, Any]:
    """Values for the README's template."""
    jets, records, waits, delay_s = resolved.commands[[0, kernelflight.RECORDS, kernelflight.WAITS, kernelflight.DELAY_S]].tolist()
    return {
        "name": line(" ".join(resolved.vehicle.name.split())),
        "version": __version__,
        "vehicle": resolved.vehicle,
        "inertia": "ixx ixy ixz iyy iyz izz [kg m^2]",
        "jets": jets,
        "records": records,
        "waits": waits,
        "delay_s": delay_s,
    }


def given(resolved: Constants, log: Log) -> str:
    """Text of vector.txt: for each phase its number and number of cycles, then one line of hexadecimal numbers per cycle."""
    lines = []
    for number, leg in enumerate(resolved.legs):
        fed = _cycles(leg, log)
        lines.append(f"{number} {len(fed)}")
        lines += [" ".join(value.hex() for value in row) for row in fed.tolist()]
    return "\n".join(lines) + "\n"


def expected(resolved: Constants, log: Log) -> str:
    """Text of expected.txt: one line per estimated cycle with the bits of values and sigmas, and the numbers of the verdicts."""
    lines = []
    for leg in resolved.legs:
        found = kernelflight.Flight(resolved.commands, leg.vehicle, leg.rule).step(_cycles(leg, log), last=True)
        for value, sigma, verdict in zip(found.values, found.sigmas, found.verdicts, strict=True):
            lines.append(" ".join([*map(bits, [*value, *sigma]), *(str(int(v)) for v in verdict)]) + "\n")
    return "".join(lines)


def bits(value: float) -> str:
    """Bits of a number in hexadecimal; a dash for NaN."""
    return "-" if np.isnan(value) else struct.pack(">d", value).hex()


def _cycles(leg: Leg, log: Log) -> Array:
    """Kernel inputs of a phase and of all cycles before it, because delayed commands and the attitude continue."""
    return kernelflight.cycles_of(log, slice(0, min(leg.cycles.stop + 1, log.cycles)), leg.cycles)
