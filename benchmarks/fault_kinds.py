"""All kinds of fault."""

from fault_body import BODY
from fault_imu import IMU
from fault_thrust import THRUST

FAULTS = {fault.name: fault for fault in (*THRUST, *IMU, *BODY)}
