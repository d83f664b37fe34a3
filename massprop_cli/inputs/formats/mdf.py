"""Reader of MDF4 by asammdf (LGPL, an extra): a path is the channel name, or ``group/channel`` if several groups have it."""

import io
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF

from massprop_cli.base import limits
from massprop_cli.inputs.formats.recording import Numbers, Read, RecordedStream, whole


def read(path: Path, data: bytes) -> Read:
    """Read all channels with unit; the clock is the group's master channel."""
    file = MDF(io.BytesIO(data))
    limits.NUMBERS.check(str(path), sum(group.channel_group.cycles_nr * len(group.channels) for group in file.groups))
    return Read(_streams(file))


def _streams(file: Any) -> Iterator[RecordedStream]:
    names = Counter(channel.name for group in file.groups for channel in group.channels)
    for at, group in enumerate(file.groups):
        rows, master = group.channel_group.cycles_nr, file.masters_db.get(at)
        paths = [name if names[name] == 1 else f"{at}/{name}" for name in (str(channel.name) for channel in group.channels)]
        clock = "" if master is None else paths[master]
        for number, channel in enumerate(group.channels):
            unit = "s" if number == master else str(getattr(channel, "unit", "") or getattr(channel.conversion, "unit", "") or "")
            load: Callable[[], Numbers] = partial(file.get_master, at) if number == master else partial(_values, file, at, number)
            yield RecordedStream(paths[number], rows, load, "" if number == master else clock, unit)


def _values(file: Any, group: int, number: int) -> Numbers:
    values = np.asarray(file.get(group=group, index=number, raw=False, ignore_invalidation_bits=True).samples)
    if values.ndim != 1 or values.dtype.kind not in "iufb":
        raise ValueError(f"channel {file.groups[group].channels[number].name} holds no plain numbers")
    return whole(values)
