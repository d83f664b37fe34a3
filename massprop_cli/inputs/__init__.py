"""Input files: logs, vehicle files, map files, expect and tolerance files; reading and validation."""
