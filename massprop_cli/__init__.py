"""massprop: mass properties of a vehicle from recorded commands and IMU data.

The flow
--------
::

    telemetry.read ─ Log ─ align ─ Aligned ─ compensate ─ Samples ─ estimate ─ History ─ conclude ─ Conclusion ─ report

One frozen type per stage, arrays with time first. :mod:`massprop_cli.flow` composes the flow.

Frames
------
==========  ==================================================================================
``imu``     the sensor's own axes; ``v_b = body_from_imu @ v_imu``
``b``       body axes X roll, Y pitch, Z yaw; origin O is the vehicle's declared reference point
``w``       world, Z up on an air bearing; quaternions are wxyz and turn body into world
==========  ==================================================================================

Units are SI inside and in files. Degrees appear only in what a person reads.

Symbols
-------
==================  =========================================================================
``I``, ``inertia``  inertia about the CG in body axes, kg m²; products are the tensor's own
                    elements, ``ixy = -Σ m x y``
``c``, ``cg``       position of the CG from O in body axes, m
``m``, ``mass``     kg; on an air bearing the bearing's translating mass is included
``mu``              1/m, 1/kg: what the accelerometer sees linearly
``w``, ``rate``     body rate, rad/s; cycle means unless said otherwise
``f``               specific force at the IMU (accelerometer: +g upward at rest), m/s²
``tau``, ``F``      executed torque about O [N m] and force [N], body axes
``T``               length of a control cycle, s
==================  =========================================================================

From Python
-----------
:func:`estimate_log` estimates one log, :func:`run_campaign` many; both give typed results and pandas tables (:mod:`massprop_cli.api`).
:class:`InputError` says what can't be used.

The ten quantities stand in one order everywhere: :data:`QUANTITIES`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from massprop_cli.base.errors import InputError

if TYPE_CHECKING:
    from massprop_cli.api import Campaign, LogEstimate, estimate_log, run_campaign

__version__ = "0.1.0"

INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
CG = ("cg_x", "cg_y", "cg_z")
QUANTITIES = (*INERTIA, *CG, "mass")
UNITS = {**dict.fromkeys(INERTIA, "kg m^2"), **dict.fromkeys(CG, "m"), "mass": "kg"}
MOMENT = ("moment_x", "moment_y", "moment_z")
ABOUT_PIVOT = (*INERTIA, *MOMENT)
"""The nine quantities about a pivot, in their order."""
PIVOT_UNITS = {name: UNITS.get(name, "kg m") for name in ABOUT_PIVOT}
PIVOT = "about_pivot."
"""Before the name of a quantity about the pivot, where it stands among the ten."""
ALL_UNITS = UNITS | {f"{PIVOT}{name}": unit for name, unit in PIVOT_UNITS.items()}
"""Of the ten quantities and the nine about a pivot, in their order."""

__all__ = ["QUANTITIES", "UNITS", "Campaign", "InputError", "LogEstimate", "__version__", "estimate_log", "run_campaign"]


def __getattr__(name: str) -> object:
    """The Python interface, imported when it is asked for: the command line must start fast."""
    if name in __all__:
        from massprop_cli import api

        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
