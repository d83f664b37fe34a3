"""Reading of a result folder: result.json, and history.parquet if it exists."""

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from massprop_cli import QUANTITIES, UNITS
from massprop_cli.base import configfile, limits
from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.lazy import pa
from massprop_cli.inputs import parquetheader
from massprop_cli.result.schema import DockedObject, PhaseItem, Result

LARGEST = 1e150
"""Largest magnitude of a number, so that squares and multiples of sigma stay finite."""
ROUNDING = 1e-9
"""Largest asymmetry of a covariance, over the product of both sigmas."""
LOGS = (".parquet", ".csv")
"""Suffixes of tables, which are not results."""


MEMBERS = "combined_sha256"
"""Setting of a combined result with the SHA-256 of all its logs."""


@dataclass(frozen=True)
class Recorded:
    """A result with its history."""

    path: Path
    """Path of result.json."""
    result: Result
    history: dict[str, dict[str, Array]]
    """(K,) values by phase and column, NaN without an estimate; empty without a history.parquet."""
    sha256: str = ""
    """SHA-256 of result.json."""

    @property
    def joint(self) -> bool:
        """Whether the result combines several logs; it then has no history."""
        return MEMBERS in self.result.provenance.settings

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.path.resolve().parent.name


def read(path: Path) -> Recorded:
    """Read a result folder or its result.json; :class:`InputError` if it is invalid."""
    file = path / "result.json" if path.is_dir() else path
    if path.is_dir() and not file.exists():
        below = sorted((*path.glob("*/result.json"), *path.glob("results/*/result.json")))
        hint = f", such as {below[0].parent}" if below else ""
        raise InputError(f"{path}: holds no result.json; name a folder that massprop estimate wrote{hint}")
    if file.suffix.lower() in LOGS and file.exists():
        raise InputError(f"{path}: is a table, not a result; if it is a log, run massprop estimate {path}, and name the folder it writes")
    result = result_of(configfile.read_text(file, "result.json"), str(file))
    return Recorded(file, result, _history(file.with_name("history.parquet"), result), hashlib.sha256(file.read_bytes()).hexdigest())


STATED: dict[str, Callable[[Result], object]] = {
    "vehicle": lambda of: of.vehicle.name,
    "environment": lambda of: of.vehicle.environment,
    "environment.gravity_m_s2": lambda of: of.vehicle.gravity_m_s2,
    "environment.bearing_position_m": lambda of: of.vehicle.bearing_position_m,
    "bearing mass [kg]": lambda of: of.vehicle.bearing_mass_kg,
    "thrust.scale_sigma": lambda of: of.vehicle.thrust_scale_sigma,
    "phases": lambda of: ", ".join(phase.name for phase in of.phases),
    "docked object": lambda of: f"{of.docked_object.after} less {of.docked_object.before}" if of.docked_object else "none",
    "inertia about": lambda of: of.conventions.inertia_about,
    "products of inertia": lambda of: of.conventions.products_of_inertia,
}
"""Properties that define the meaning of a result's values, by their name in messages."""


def check_same(path: Path, own: Result, other: str, theirs: Result, what: Iterable[str], so: str) -> None:
    """Raise :class:`InputError` if two results differ in one of the properties ``what``; ``so``: consequence and remedy."""
    for name in what:
        if STATED[name](own) != STATED[name](theirs):
            raise InputError(f"{path}: {name} is {STATED[name](own)!r}, and {STATED[name](theirs)!r} in {other}; {so}")


def result_of(text: str, file: str) -> Result:
    """Parse the text of a result.json; :class:`InputError` names ``file`` and the first invalid entry."""
    try:
        data = json.loads(text, parse_constant=_finite, parse_float=_finite, parse_int=_whole)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file}: not valid JSON ({error}); make it again with massprop estimate") from None
    if not isinstance(data, dict) or data.get("schema") != "massprop/result/1":
        found = data.get("schema") if isinstance(data, dict) else type(data).__name__
        raise InputError(f"{file}: schema is {found!r}, not 'massprop/result/1'; name the result.json that massprop estimate wrote")
    try:
        result = Result.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{file}: {where}: {first['msg']}; it was written by another version or edited. Make it again") from None
    parts: list[PhaseItem | DockedObject] = [*result.phases, *([result.docked_object] if result.docked_object else [])]
    for part in parts:
        if list(part.estimates) != list(QUANTITIES):
            raise InputError(
                f"{file}: estimates hold {', '.join(part.estimates) or 'nothing'}, not the ten quantities in their order; make it again"
            )
        problem = _contradiction(part)
        if problem:
            raise InputError(f"{file}: {problem}; it was edited. Make it again")
    return result


def _finite(text: str) -> float:
    """Number from JSON; ValueError for NaN, infinity, and a magnitude above :data:`LARGEST`."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text} is not a finite number")
    if abs(number) > LARGEST:
        raise ValueError(f"{text} is larger than {LARGEST:g} in size, which no result is")
    return number


def _whole(text: str) -> int:
    _finite(text)
    return int(text)


def _contradiction(part: PhaseItem | DockedObject) -> str:
    """First invalid number of a phase or docked object, in words; empty without one."""
    for name, item in part.estimates.items():
        if item.unit != UNITS[name]:
            return f"the unit of {name} is {item.unit!r}, not {UNITS[name]!r}"
        if item.sigma is not None and item.sigma < 0:
            return f"the sigma of {name} is {item.sigma:g}, below 0"
        if item.sigma is not None and 0 < item.sigma < 1 / LARGEST:
            return f"the sigma of {name} is {item.sigma:g}, smaller than any but 0"
        if item.value is not None and item.sigma is None:
            return f"{name} has a value and no sigma"
    covariance = np.array(part.covariance, dtype=float)
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    apart = np.abs(covariance - covariance.T) > ROUNDING * np.outer(sigmas, sigmas)
    unmatched = np.isnan(covariance) != np.isnan(covariance.T)
    if (apart | unmatched).any() or (np.diag(covariance) < 0).any():
        return "covariance is not symmetric, or has a variance below 0"
    return ""


def _history(file: Path, result: Result) -> dict[str, dict[str, Array]]:
    """History by phase and column; empty without a file. :class:`InputError` if it is invalid or has other phases."""
    if not file.exists():
        return {}
    try:
        held = parquetheader.ParquetColumns(str(file), limits.content(file, "history.parquet"))
        phase = np.array(held.column("phase").to_pylist())
        columns = {name: np.array(held.column(name).to_pylist(), dtype=float) for name in held.names if name != "phase"}
    except (OSError, pa.ArrowException, KeyError, ValueError, TypeError) as error:
        raise InputError(f"{file}: cannot be read ({error}); make it again with massprop estimate") from None
    if {str(name) for name in phase} != {phase.name for phase in result.phases}:
        raise InputError(f"{file}: holds other phases than result.json beside it; make both again with massprop estimate")
    found = {item.name: {name: values[phase == item.name] for name, values in columns.items()} for item in result.phases}
    for item, own in found.items():
        for name, values in own.items():
            problem = _disorder(name, values)
            if problem:
                raise InputError(f"{file}: {name} in phase {item} {problem}; it was edited. Make it again with massprop estimate")
    return found


def _disorder(name: str, values: Array) -> str:
    """Defect of a history's column, in words; empty without one."""
    if values.ndim != 1:
        return "holds no numbers"
    if (np.abs(values) > LARGEST).any():
        return f"holds numbers beyond {LARGEST:g}"
    if "_sigma" in name and (values < 0).any():
        return "is below 0"
    if name == "time_s" and not (np.isfinite(values).all() and (np.diff(values) > 0).all()):
        return "does not increase"
    return ""


def labels(recorded: Sequence[Recorded]) -> list[str]:
    """Shortest distinct folder names: "log", or "monday/log" and "friday/log"."""
    folders = [item.path.resolve().parent.parts for item in recorded]
    depth = 1
    while len({folder[-depth:] for folder in folders}) < len(set(folders)):
        depth += 1
    return ["/".join(part.strip("/") for part in folder[-depth:]) or "/" for folder in folders]
