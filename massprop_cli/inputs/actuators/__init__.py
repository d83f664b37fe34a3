"""Actuators, one module each. ``actuator`` is the interface; a field of :class:`massprop_cli.inputs.vehicle.Vehicle` lists each."""
