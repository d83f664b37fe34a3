"""The scale of what wheels alone store, which no log shows."""

from __future__ import annotations

import numpy as np

from massprop_cli.conclude.discrepancy import STORED, discrepancy
from massprop_cli.errorparameters.table import BY_NAME
from massprop_cli.estimate.discrepancy import LEAST
from massprop_cli.flow import examine
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.resolved import Resolved
from tests import anypedestal


def test_sigmas_of_a_misfit_beneath_wheels_have_their_common_scale_in_them() -> None:
    """Inertia and first moment follow the spin inertias; a fit that is not quite linear told it to 0.05 %, and was off by 0.4 %."""
    rng = np.random.default_rng(6)
    own = anypedestal.tables(rng, 4)
    flown = anypedestal.fly(rng, own, "wheels", 0.05, 15.0)
    used = anypedestal.vehicle_of(own, 0, flown, False)
    found = examine(anypedestal.log_of(rng, own, 0, flown, used), VehicleSource(used, "", ""))
    assert found.plain is not None
    assert isinstance(found.vehicle, Resolved)
    told = discrepancy(found.samples, found.timing, found.vehicle, found.settled[0], found.plain, 0)
    assert told is not None
    least = BY_NAME["spin_inertia"].usual * LEAST * np.abs(told.values[[0, 3, 5]])
    assert (np.sqrt(np.diag(told.covariance))[[0, 3, 5]] > least).all()
    np.testing.assert_allclose(told.shares[STORED][[0, 3, 5]], least * told.scale / LEAST if told.scale > LEAST else least, rtol=1e-9)
