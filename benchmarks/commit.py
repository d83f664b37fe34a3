"""Which state of the project a table was made with."""

import subprocess
from pathlib import Path


def commit() -> str:
    """The commit, with "-dirty" where files differ from it."""
    command = ["git", "describe", "--always", "--dirty"]
    return subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True).stdout.strip()
