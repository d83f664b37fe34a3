"""Equations of motion by environment, one file each, and the choice of the one that the vehicle file states."""

import numpy as np

from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.plant.bearing import BearingBody
from massprop_cli.model.plant.free import FreeBody
from massprop_cli.model.plant.pedestal import PedestalBody
from massprop_cli.model.plant.planar import PlanarBody
from massprop_cli.model.plant.plant import Motion, Plant, Reference, SpecificForce


def plant_of(vehicle: Vehicle) -> Plant:
    """The equations of motion of the environment that the vehicle file states."""
    environment = vehicle.environment
    if environment.kind == "free":
        return FreeBody()
    if environment.kind == "planar":
        return PlanarBody(environment.gravity_m_s2 * environment.table_tilt_sigma_rad)
    pivot, gravity = np.array(environment.bearing_position_m), environment.gravity_m_s2
    if environment.kind == "pedestal":
        return PedestalBody(pivot, 0.0, gravity)
    return BearingBody(pivot, environment.bearing_mass_kg, gravity)


__all__ = ["BearingBody", "FreeBody", "Motion", "PedestalBody", "PlanarBody", "Plant", "Reference", "SpecificForce", "plant_of"]
