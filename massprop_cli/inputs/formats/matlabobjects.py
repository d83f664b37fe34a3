"""MATLAB objects in mat-io's form: times and samples of a timeseries, and detection of other objects."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from massprop_cli.inputs.formats.recording import Numbers, RecordedStream, stream, whole

REMEDY = "save its numbers in MATLAB as a struct, of a timeseries ts as s = struct('time', ts.Time, 'data', ts.Data); save('log.mat', 's')"
_TIME_UNITS = {
    "nanoseconds": ("ns", 1), "microseconds": ("us", 1), "milliseconds": ("ms", 1), "seconds": ("s", 1),
    "minutes": ("s", 60), "hours": ("s", 3600), "days": ("s", 86400), "weeks": ("s", 604800),
}  # fmt: skip
"""massprop's unit for each of MATLAB's time units, and the factor to it."""
_MOST = 64
"""Maximum number of components per sample; more are images, not signals."""


class UnreadableError(Exception):
    """Object without readable numbers, with the reason."""


def is_object(value: Any) -> bool:
    """Whether a value is a class object that mat-io does not convert."""
    return hasattr(value, "classname") and isinstance(getattr(value, "properties", None), dict)


def is_timeseries(value: Any) -> bool:
    """Whether it is a ``timeseries``, by its class or its properties."""
    held = value.properties
    return value.classname == "timeseries" or ("TimeInfo" in held and ("Data_" in held or "Data" in held))


def timeseries(path: str, value: Any) -> Iterator[RecordedStream]:
    """Streams ``ts.Time`` and ``ts.Data``, one per component. Raises :class:`UnreadableError` if one has no numbers."""
    held = value.properties
    data = _numbers(held, "Data_", "Data")
    if data is None:
        raise UnreadableError("without numbers")
    info = _properties(held.get("TimeInfo"))
    times, unit = _times(held, info, data)
    parts = list(_components(data, len(times), bool(np.any(held.get("IsTimeFirst_", True)))))
    clock = f"{path}.Time"
    yield stream(clock, times, unit=unit)
    own = _text(_properties(held.get("DataInfo")).get("Units"))
    yield from (stream(f"{path}.Data{at}", whole(values), clock, own) for at, values in parts)


def _times(held: Mapping[str, Any], info: Mapping[str, Any], data: Numbers) -> tuple[Numbers, str]:
    """Times and their unit; evenly spaced times are stored as start and increment."""
    name = _text(info.get("Units")) or "seconds"
    if name not in _TIME_UNITS:
        raise UnreadableError(f"with times in {name}")
    unit, factor = _TIME_UNITS[name]
    own = _numbers(held, "Time_", "Time")
    times = _numbers(info, "Time_", "Time") if own is None else own
    if times is None:
        start, step, length = (_numbers(info, name, name.rstrip("_")) for name in ("Start_", "Increment_", "Length"))
        if step is None or length is None or not 0 < float(length.ravel()[0]) <= data.size:
            raise UnreadableError("without times")
        begun = 0.0 if start is None else float(start.ravel()[0])
        times = begun + float(step.ravel()[0]) * np.arange(int(length.ravel()[0]))
    return times.ravel() if factor == 1 else times.ravel().astype(float) * factor, unit


def _components(data: Numbers, count: int, time_first: bool) -> Iterator[tuple[str, Numbers]]:
    """MATLAB index and values of each component of the samples: ``(1,1,:)`` for size 3 x 1 x n."""
    if data.size == count:
        yield "", data.ravel()
        return
    first, last = data.shape[0] == count, data.shape[-1] == count
    if not (first or last) or data.size > _MOST * count:
        raise UnreadableError(f"of {count} times and {' x '.join(map(str, data.shape))} numbers")
    axis = 0 if first and (time_first or not last) else data.ndim - 1
    samples = np.moveaxis(data, axis, 0)
    for component in sorted(np.ndindex(samples.shape[1:]), key=lambda at: at[::-1]):
        index = [str(number + 1) for number in component]
        index.insert(axis, ":")
        yield f"({','.join(index)})", samples[(slice(None), *component)]


def _numbers(held: Mapping[str, Any], *names: str) -> Numbers | None:
    """Values of the first of these properties that has numbers."""
    values = (held.get(name) for name in names)
    return next((one for one in values if isinstance(one, np.ndarray) and one.dtype.kind in "iufb" and one.size), None)


def _properties(value: Any) -> Mapping[str, Any]:
    """Properties of an object within an object."""
    value = value.item() if isinstance(value, np.ndarray) and value.dtype == object and value.size == 1 else value
    return value.properties if is_object(value) else {}


def _text(value: Any) -> str:
    """MATLAB text; empty for other values."""
    value = value.ravel()[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    return str(value) if isinstance(value, str) else ""
