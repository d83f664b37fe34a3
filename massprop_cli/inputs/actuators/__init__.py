"""Actuators, one module each: what the vehicle file states of one, which columns a log has of it, and what it does in time.

``actuator`` is the seam. A module has a subclass of :class:`~massprop_cli.inputs.actuators.actuator.Actuator`, and the vehicle file has a
field of it (:class:`massprop_cli.inputs.vehicle.Vehicle`), which lists it for everything else.
"""
