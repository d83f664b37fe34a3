"""What was known of a result is taken out before results are added up, and put in once."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.combine.joint import Piece, _bare
from massprop_cli.estimate.quantities import alone, quantities
from massprop_cli.estimate.rows import Parameters
from massprop_cli.model.plant import BearingBody
from tests import flight


@pytest.mark.parametrize(
    ("known", "relative"), [(("mass",), 0.02), (("cg_x",), 0.1), (("mass", "cg_x"), 0.02), (("izz", "mass", "cg_z"), 0.02)]
)
def test_what_was_known_is_taken_out_of_a_bearings_result_as_it_was_put_in(known: tuple[str, ...], relative: float) -> None:
    """Mass or CG two sigmas off, in a valley of both that is curved."""
    part, bearing, true = 5.0, np.array([0.02, -0.01, 0.03]), flight.ON_BEARING.copy()
    true[6:9] = bearing + np.array([1e-3, -2e-3, 1.5e-3])
    spread = np.diag(np.append((1e-3 * np.ones(9)) ** 2, (relative / true[9]) ** 2))
    slope = (true[6:9] - bearing) * true[9] / (1 - part / true[9])
    spread[6:9, 6:9] = 1e-14 * np.eye(3) + np.outer(slope, slope) * spread[9, 9]
    spread[6:9, 9] = spread[9, 6:9] = slope * spread[9, 9]
    told = Parameters.of(np.append(true[:9], 1 / true[9])[None], spread[None])
    aside = true[6:9] + 2 * slope * relative / true[9]
    off = {"mass": 1.04 * true[9], "cg_x": aside[0], "cg_z": aside[2], "izz": true[5] + 1e-3}
    stated = {name: {"value": off[name], "sigma": 1e-3 * abs(off[name])} for name in known}
    environment = {"bearing_position_m": bearing.tolist(), "bearing_mass_kg": part}
    used = flight.vehicle("air_bearing", environment=environment, known=stated)
    values, covariance = quantities(told, used)
    pairs = {str(name): (one.value, one.sigma) for name, one in used.known.items()}
    piece = Piece(values[0], covariance[0], pairs, bearing=BearingBody(bearing, part, 9.81))
    bare, own = _bare(piece)
    expected, before = quantities(told, alone(used))
    sigma = np.sqrt(np.diag(before[0]))
    assert (np.abs(bare - expected[0]) < 0.02 * sigma).all()
    np.testing.assert_allclose(np.sqrt(np.diag(own)), sigma, rtol=0.1)
