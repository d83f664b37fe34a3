"""The folder that flies: the kernel's sources, the vehicle's tables, a test vector, a Makefile and a README."""

import struct
from pathlib import Path

import numpy as np

from massprop_cli import __version__
from massprop_cli import kernel as kernel_room
from massprop_cli.base import files
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.base.escape import line
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
"""What serves the ground alone."""


def write(resolved: Constants, folder: Path) -> list[str]:
    """Write all of it, whole; the files' names."""
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
    """Each file's text."""
    sources = sorted(path for path in SOURCES.iterdir() if path.suffix in (".c", ".h") and path.name not in HOST)
    found = {path.name: path.read_text(encoding="utf-8") for path in sources}
    found |= {name: (TEMPLATES / name).read_text(encoding="utf-8") for name in ("replay.c", "size.c")}
    found |= {"table.h": tables.header(resolved), "table.c": tables.source(resolved)}
    if resolved.log is not None:
        if kernel().library is None:
            raise InputError(
                f"{resolved.log.path}: a test vector wants the compiled kernel, and here runs {kernel().name}; "
                "install a C compiler and massprop again, or leave the log out",
                option="log",
            )
        found |= {"vector.txt": given(resolved, resolved.log), "expected.txt": expected(resolved, resolved.log)}
    names = " ".join(path.name for path in sources if path.suffix == ".c")
    return found | {"README.md": _readme(resolved), "Makefile": _makefile(resolved, names)}


def _makefile(resolved: Constants, sources: str) -> str:
    programs = ("replay", "sanitized")
    flown = "".join(
        f"\tif [ -x {program} ]; then $(RUN) ./{program} < vector.txt > replayed.txt && cmp replayed.txt expected.txt; fi\n"
        for program in programs
    )
    test = flown if resolved.log is not None else "\t@echo 'built, and nothing flown: no log was given, so there is no test vector'\n"
    text = (TEMPLATES / "Makefile.in").read_text(encoding="utf-8")
    return text.replace("@LIMITS@", tables.limits(resolved)).replace("@KERNEL@", sources).replace("@TEST@\n", test + "\n")


def _readme(resolved: Constants) -> str:
    vehicle = resolved.vehicle
    waits, delay_s = resolved.commands[[kernelflight.WAITS, kernelflight.DELAY_S]]
    period_s, inertia = vehicle.cycle.period_s, "ixx ixy ixz iyy iyz izz [kg m^2]"
    said = {
        "NAME": line(" ".join(vehicle.name.split())),
        "TEST": "flies vector.txt as it was flown on the ground, and compares every bit of every value and sigma"
        if resolved.log is not None
        else "builds it under every warning; made with --log it also flies that log, and compares every bit with the ground",
        "VERSION": __version__,
        "PERIOD": f"{period_s:g}",
        "RECORDS": f"{resolved.commands[kernelflight.RECORDS]:g}",
        "BEARING": "On the bearing inertia and CG are those of what turns, and the mass has the bearing's in it. "
        if vehicle.on_air_bearing
        else "",
        "COMMAND": f": {len(vehicle.jets)} on-times in s" if resolved.commands[0] else ": torque about O [N m] and force [N]",
        "COMMANDED": "an on-time below 0 or longer than a period by more than a thousandth of it"
        if resolved.commands[0]
        else "a torque or force of 1e9 or more",
        "WHEELS": f" `flown.speed`: of the {len(vehicle.wheels)} wheels relative to the body, at the cycle's end, rad/s."
        if vehicle.wheels
        else "",
        "POINT": "pivot" if vehicle.on_pedestal else "CG",
        "CG": "The first moment is m (CG - pivot)." if vehicle.on_pedestal else "The CG is counted from O.",
        "VALUES": f"{inertia}, first moment about the pivot x y z [kg m], and no mass"
        if vehicle.on_pedestal
        else f"the ten quantities ({inertia}, cg_x cg_y cg_z [m], mass [kg])",
        "DELAY": "A cycle's values come with the next call, since the next command may go on with a pulse."
        if waits
        else f"Commands are executed {delay_s:g} s after the start of their cycle.",
    }
    text = (TEMPLATES / "README.in").read_text(encoding="utf-8")
    for name, value in said.items():
        text = text.replace(f"@{name}@", value)
    return text


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
    lines = []
    for leg in resolved.legs:
        found = kernelflight.Flight(resolved.commands, leg.vehicle, leg.rule).step(_cycles(leg, log), last=True)
        for value, sigma, verdict in zip(found.values, found.sigmas, found.verdicts, strict=True):
            lines.append(" ".join([*map(bits, [*value, *sigma]), *(str(int(v)) for v in verdict)]) + "\n")
    return "".join(lines)


def bits(value: float) -> str:
    """A number's bits in hexadecimal, or a dash where nothing is told."""
    return "-" if np.isnan(value) else struct.pack(">d", value).hex()


def _cycles(leg: Leg, log: Log) -> Array:
    """From the log's first cycle on, since commands in flight and the attitude go on."""
    return kernelflight.cycles_of(log, slice(0, min(leg.cycles.stop + 1, log.cycles)), leg.cycles)
