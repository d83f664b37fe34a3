"""A logged attitude as a map states it, to unit quaternions."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.formats import resample
from massprop_cli.inputs.formats.mapfile import Attitude

_NORM = 1e-2
"""By which a quaternion's norm may be off 1."""


class NormError(Exception):
    """A row whose four numbers are no quaternion."""

    def __init__(self, row: int, norm: float) -> None:
        super().__init__(row, norm)
        self.row, self.norm = row, norm


def quaternions(said: Attitude, recorded: Array) -> Array:
    """(n, 4) unit quaternions wxyz of the file's own world from body, of recorded ones (n, 4), or headings (n, 1) in rad.

    :class:`NormError` where one is none.
    """
    if said.order == "heading":
        half, none = recorded[:, 0] / 2, np.zeros(len(recorded))
        recorded = np.stack([np.cos(half), none, none, np.sin(half)], 1)
    found = recorded[:, [3, 0, 1, 2]] if said.order == "xyzw" else recorded
    norm = np.linalg.norm(found, axis=1)
    bad = np.flatnonzero(np.abs(norm - 1) > _NORM)
    if bad.size:
        raise NormError(int(bad[0]), float(norm[bad[0]]))
    found = found / norm[:, None]
    if said.turns == "body_from_world":
        found = found * np.array([1, -1, -1, -1])
    return resample.about_axes(found, said.axes)
