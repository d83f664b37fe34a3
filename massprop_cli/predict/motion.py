"""Part of a log's motion that given values explain without a fit, by channel and by manoeuvre."""

from dataclasses import replace

import numpy as np

from massprop_cli import ABOUT_PIVOT, QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.levels import BLOCK
from massprop_cli.base.rigidbody import elements, tensor
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.estimate import offline
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.predict.document import Explained, MotionItem
from massprop_cli.result.schema import PhaseItem, VehicleInfo

CHANNELS = ("rate_x", "rate_y", "rate_z", "specific_force_x", "specific_force_y", "specific_force_z")
MANOEUVRES = ("torque_x", "torque_y", "torque_z", "force_x", "force_y", "force_z", "rest")
ALL = "all"
RESTING = 0.05
"""Largest command of a cycle at rest, as a part of the largest command on each axis."""


def explained(found: Analysis, number: int, sides: tuple[tuple[VehicleInfo, PhaseItem], tuple[VehicleInfo, PhaseItem]]) -> list[MotionItem]:
    """Motion of phase ``number`` of a log explained by a result's values and by its own; empty if either is not a possible body."""
    settled, vehicle = found.settled[number], found.vehicle
    own = settled.reference
    if own is None or not isinstance(vehicle, Resolved):
        return []
    used = vehicle.in_phase(settled.phase)
    references = [one for side in sides if (one := reference(own, used, *side)) is not None]
    if len(references) < len(sides):
        return []
    passes = [offline.prediction_residuals(found.samples, settled.cycles, one, used) for one in references]
    groups = _manoeuvres(found, settled.cycles)
    items = []
    for c, channel in enumerate(CHANNELS):
        for manoeuvre in (ALL, *MANOEUVRES):
            chosen = np.ones(len(groups), dtype=bool) if manoeuvre == ALL else groups == manoeuvre
            chosen &= np.isfinite(passes[0][0].value[:, c]) & np.isfinite(passes[1][0].value[:, c])
            if settled.unread[c] or not chosen.any():
                continue
            by_result, by_log = (_explained(*(of[chosen, c] for of in (left.value, left.sigma, motion.value))) for left, motion in passes)
            unit = "rad/s" if c < 3 else "m/s^2"
            rms = float(np.sqrt((passes[0][1].value[chosen, c] ** 2).mean()))
            items.append(
                MotionItem(
                    channel=channel, manoeuvre=manoeuvre, unit=unit, cycles=int(chosen.sum()), motion_rms=rms, result=by_result, log=by_log
                )
            )
    return items


def _explained(left: Array, sigma: Array, motion: Array) -> Explained:
    power = float((motion**2).sum())
    return Explained(
        percent=100 * (1 - float((left**2).sum()) / power) if power > 0 else None,
        residual_rms=float(np.sqrt((left**2).mean())),
        expected_rms=float(np.sqrt((sigma**2).mean())),
        mean_square=float(((left / sigma) ** 2).mean()),
    )


def reference(own: Reference, used: Resolved, vehicle: VehicleInfo, phase: PhaseItem) -> Reference | None:
    """A phase's values as parameters of the equations of motion; ``own`` replaces missing ones. None for an impossible body.

    If a known mass implies a thrust scale, inertia and mass are divided by it, to predict the motion with the stated thrust.
    """
    if vehicle.environment == "pedestal":
        values = np.array([phase.about_pivot[name].value for name in ABOUT_PIVOT], dtype=float)
        inertia, moment = values[:6], values[6:]
        cg, mu = np.array(vehicle.bearing_position_m) + moment * own.mu, own.mu
    else:
        values = np.array([phase.estimates[name].value for name in QUANTITIES], dtype=float)
        implied = phase.implied_thrust_scale
        scale = implied.value if implied is not None and vehicle.thrust_scale_sigma > 0 else 1.0
        held, bearing = vehicle.bearing_mass_kg, np.array(vehicle.bearing_position_m)
        # the weight gives the first moment of the rotating mass about the bearing
        cg = bearing + (values[6:9] - bearing) * (values[9] - held) / (values[9] - held * scale) if held else values[6:9]
        beyond: Array = sum((elements(device.beyond_reported) for device in used.spinning), np.zeros(6))
        inertia, mu = values[:6] / scale + beyond, scale / values[9]
    inertia = np.where(np.isfinite(inertia), inertia, elements(own.inertia))
    told = bool(np.isfinite(mu))
    chosen = replace(
        own, inertia=tensor(inertia), cg=np.where(np.isfinite(cg), cg, own.cg), mu=float(mu) if told else own.mu, response=None
    )
    return chosen if np.linalg.eigvalsh(chosen.inertia)[0] > 0 and chosen.mu > 0 else None


def _manoeuvres(found: Analysis, cycles: slice) -> Array:
    """(K,) manoeuvre of each cycle: the axis with the largest command, relative to the largest of all cycles on that axis."""
    parts = [found.samples.part(slice(at, min(at + BLOCK, cycles.stop))) for at in range(cycles.start, cycles.stop, BLOCK)]
    executed = [part.executed for part in parts]
    channels = np.concatenate([(one.channels.whole / one.duration_s[:, None]) @ one.channels.wrench for one in executed])
    size = np.abs(channels).max(0)
    # ignore axes with parasitic commands: torques by lever arms of forces, unequal jets
    size[:3] = np.where(size[:3] > RESTING * size[:3].max(), size[:3], np.inf)
    size[3:] = np.where(size[3:] > RESTING * size[3:].max(), size[3:], np.inf)
    share = np.abs(channels) / np.where(size > 0, size, np.inf)
    return np.where(share.max(1) < RESTING, MANOEUVRES[-1], np.array(MANOEUVRES)[share.argmax(1)])
