"""Export of flight code: the kernel's sources with one vehicle's tables and, from a log, a test vector."""
