"""Units of recordings with factors to SI, one table per quantity."""

import math
import re
from collections.abc import Mapping

DEG, G = math.pi / 180, 9.80665
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLE = {"rad": 1.0, "deg": DEG, "mrad": 1e-3}
SPIN = {"rad/s": 1.0, "deg/s": DEG, "mrad/s": 1e-3, "mdeg/s": 1e-3 * DEG, "rpm": math.pi / 30}
"""Rates, and speeds of rotors and wheels."""
SPEED = {"m/s": 1.0, "mm/s": 1e-3}
ACCELERATION = {"m/s^2": 1.0, "g": G, "mg": 1e-3 * G, "mm/s^2": 1e-3}
TORQUE = {"N m": 1.0, "mN m": 1e-3, "uN m": 1e-6}
FORCE = {"N": 1.0, "mN": 1e-3, "uN": 1e-6}
SHARE = {"open": 1.0, "%": 0.01}
"""Opening of a valve: 0 to 1, or per cent."""
PLAIN = {"1": 1.0, "%": 0.01}
"""Command of a rotor."""
VOLTAGE = {"V": 1.0, "mV": 1e-3}
PRESSURE = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "mbar": 1e2, "psi": 6894.757}
TABLES = (TIME, ANGLE, SPIN, SPEED, ACCELERATION, TORQUE, FORCE, SHARE, VOLTAGE, PRESSURE)
_ALIKE = {
    "sec": "s", "second": "s", "seconds": "s", "msec": "ms", "µs": "us", "μs": "us", "usec": "us", "microseconds": "us", "nsec": "ns",
    "nanoseconds": "ns", "milliseconds": "ms", "radian": "rad", "radians": "rad", "degree": "deg", "degrees": "deg", "°": "deg",
    "dps": "deg/s", "°/s": "deg/s", "degree/s": "deg/s", "degrees/s": "deg/s", "radians/s": "rad/s", "radps": "rad/s", "degps": "deg/s",
    "mdps": "mdeg/s", "m/s2": "m/s^2", "m/s²": "m/s^2", "m/s/s": "m/s^2", "m/s/2": "m/s^2", "m/s**2": "m/s^2", "mps2": "m/s^2",
    "mss": "m/s^2", "ms2": "m/s^2", "g0": "g", "gee": "g",
    "nm": "n m", "n.m": "n m", "n·m": "n m", "n*m": "n m", "newton metre": "n m", "newton": "n", "mnm": "mn m", "mn·m": "mn m",
    "µn": "un", "percent": "%", "rev/min": "rpm", "r/min": "rpm", "1/min": "rpm", "min^-1": "rpm", "min-1": "rpm",
    "volt": "v", "volts": "v",
}  # fmt: skip
_BEHIND = re.compile(r"(?:/\s*)?[\[(]\s*([^\])]{1,20})\s*[\])]\s*$|\s/\s*(\S{1,20})\s*$")
_INDEX = re.compile(r"[\d\s,:]+")
_GAUSS = ("mG", "uG", "µG", "nG")
_FOREIGN = re.compile(
    r"(?<![a-z])(ft|foot|feet|in|inch|inches|lb|lbs|lbf|lbm|oz|ozf|kgf|gf|kp|dyn|dyne|rev|revs|revolutions?|rot|turns?|rps|hz|gon|arcsec|"
    r"arcmin|mas|urad|gal|cm|km|kn|knots?|kt|mph|kmh|kph|h|hrs?|hours?|mins?|minutes?|counts?|cnt|lsb|bits?|ticks?|raw|krpm)(?![a-z])",
    re.IGNORECASE,
)
"""Words of units that massprop does not convert."""
_SECOND = re.compile(r"(?<=/)\s*sec(?:ond)?s?(?![a-z])")
_WORDS = 4
"""Maximum number of words of a unit in a name: ``m_per_s_squared``."""
_POWER = re.compile(r"\s*([a-zµμ°]+)\s*[·*. ]?\s*s(?:\^|\*\*)?(?:-|⁻)(\d|¹|²)$")


def plain(text: str) -> str:
    """Normalised spelling of a unit: ``M/S2`` and ``m s-2`` give ``m/s^2``; ``mG`` (gauss) stays as it is."""
    if text.strip("[]() ") in _GAUSS:
        return text.strip("[]() ")
    word = _SECOND.sub("s", " ".join(text.lower().split()).strip("[]() "))
    power = _POWER.match(word)
    if power:
        word = f"{power[1]}/s" + ("^2" if power[2] in "2²" else "")
    return _ALIKE.get(word.replace(" ", "") if word.replace(" ", "") in _ALIKE else word, _ALIKE.get(word, word))


def factor(text: str, known: Mapping[str, float]) -> float | None:
    """Factor to SI; None if it is not a unit of this quantity."""
    return next((value for unit, value in known.items() if plain(unit) == plain(text)), None)


def is_any(text: str) -> bool:
    """Whether it is a unit of any quantity in :data:`TABLES`."""
    return any(factor(text, table) is not None for table in TABLES)


def is_foreign(text: str) -> bool:
    """Whether it is a unit that massprop does not convert; labels such as ``body`` or ``imu0`` are not."""
    return not is_any(text) and _FOREIGN.search(text) is not None


def without_name_unit(name: str) -> tuple[str, str]:
    """Name without the unit in its last words, and the unit: ``gx`` and ``deg/s`` for ``gx_deg_s``; ``rads`` means rad/s."""
    words = name.split("_")
    for count in range(min(_WORDS, len(words) - 1), 0, -1):
        text = "_".join(words[-count:]).replace("_per_", "/").replace("_squared", "2")
        for between in "/", " ":
            unit = text.replace("_", between)
            unit = "rad/s" if unit.lower() == "rads" else unit
            if is_any(unit):
                return "_".join(words[:-count]), unit
    return name, ""


def without_suffix_unit(name: str) -> tuple[str, str]:
    """Header without the unit at its end, and the unit: ``gyro_x [deg/s]``, ``ax / g``. An index as in ``xyz[0]`` is not a unit."""
    found = _BEHIND.search(name)
    unit = "" if found is None else found[1] or found[2]
    if found is None or _INDEX.fullmatch(unit) or (found[1] is None and not is_any(unit)):
        return name, ""
    return name[: found.start()].rstrip(), unit
