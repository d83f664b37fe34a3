"""What a person states: ballast files, the remainder wanted (``--leave``), and what was moved (``--moved``)."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from massprop_cli.base import configfile
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.ballast import Ballast, BallastFile
from massprop_cli.result.read import Recorded

_ITEM = re.compile(r"\s*([xyz])\s*=\s*([-+−]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
_UNITS = {"kg m": 1.0, "kg mm": 1e-3, "g m": 1e-3, "g cm": 1e-5, "g mm": 1e-6}
_TORQUES = {"N m": 1.0, "mN m": 1e-3, "N mm": 1e-3}
EXAMPLE = 'write for instance --leave "z=-500 g cm", or "x=0, y=0, z=-0.05 N m"'


def ballast(path: Path | None, recorded: Recorded) -> tuple[Ballast, ...]:
    """Of a ballast file or a vehicle file, else what the result carries; :class:`InputError` names file, key and remedy."""
    if path is None:
        if not recorded.result.vehicle.ballast:
            raise InputError(f"{recorded.path}: carries no [[ballast]]; name a file that has it, or add it to the vehicle file", "ballast")
        return tuple(recorded.result.vehicle.ballast)
    text = configfile.read_text(path, "ballast file")
    data = configfile.parse_toml(text, str(path))
    if "cycle" not in data:
        return configfile.validate(BallastFile, data, str(path), text).ballast
    found = vehiclefile.load(path).vehicle.ballast
    if not found:
        raise InputError(f"{path}: is a vehicle file without [[ballast]]; add these, or name another file", "ballast")
    return found


def leave(text: str | None, gravity: float) -> Mapping[int, float]:
    """Stated components of the remainder by axis number, kg m; :class:`InputError` says how to write one."""
    found: dict[int, float] = {}
    for item in (text or "").split(",") if text else []:
        parts = _ITEM.fullmatch(item)
        if parts is None:
            raise InputError(f"--leave {item.strip()!r}: not a component of the first moment; {EXAMPLE}")
        number, unit = float(parts[2].replace("−", "-")), " ".join(parts[3].replace("*", " ").replace("·", " ").split())
        scales = _UNITS | {name: factor / gravity for name, factor in _TORQUES.items()}
        if unit not in scales and (unit or number):
            said = f"{unit!r} is not a unit of a first moment" if unit else "the unit is missing"
            raise InputError(f"--leave {item.strip()!r}: {said}; give it in {', '.join(scales)}")
        axis = "xyz".index(parts[1])
        if axis in found or not math.isfinite(number):
            raise InputError(f"--leave {item.strip()!r}: state each component once, as a finite number; {EXAMPLE}")
        found[axis] = number * scales.get(unit, 0.0)
    return found


def moved(texts: Sequence[str], stated: Sequence[Ballast]) -> list[float]:
    """Changes of each ballast, m or kg, as ``NAME=NUMBER`` says in mm or g; 0 of those that are not named."""
    found, names = [0.0] * len(stated), [one.name for one in stated]
    for text in texts:
        name, equals, number = (part.strip() for part in text.partition("="))
        try:
            value = float(number.removesuffix("mm").removesuffix("g").replace("−", "-")) / 1000
        except ValueError:
            value = math.nan
        if not equals or not math.isfinite(value):
            raise InputError(f"--moved {text!r}: not NAME=NUMBER; write for instance --moved x=12.5, in mm, or g where weight is added")
        if name not in names:
            raise InputError(f"--moved {text!r}: there is no ballast {name!r}{configfile.nearest(name, names, 'the nearest is')}")
        one, (low, high) = stated[names.index(name)], stated[names.index(name)].room
        if not low * (1 + 1e-9) <= value <= high * (1 + 1e-9):
            unit = "mm" if one.slides else "g"
            span = f"{1000 * low:.6g} to {1000 * high:.6g} {unit}"
            raise InputError(
                f"--moved {text!r}: the ballast file allows {span}; correct it, or {'travel_m' if one.slides else 'max_mass_kg'}"
            )
        found[names.index(name)] = value
    return found
