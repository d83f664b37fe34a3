"""What is given: logs, vehicle files, expect and tolerance files, read and checked."""
