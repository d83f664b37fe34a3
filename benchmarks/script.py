"""What every script has: a command line, the state of the project that its page was made with, the CPU time of commands."""

import argparse
import os
import resource
import subprocess
from pathlib import Path

SAMPLES = Path(__file__).parents[1] / "sample_logs"
KEPT = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
"""The environment, in which Python keeps what it has compiled, as of an installed package."""


def counted(doc: str | None, **numbers: int | None) -> argparse.ArgumentParser:
    """The command line of a script with this docstring: options that take whole numbers, and their defaults."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in numbers.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    return parser


def commit() -> str:
    """The commit, with "-dirty" where files differ from it."""
    command = ["git", "describe", "--always", "--dirty"]
    return subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True).stdout.strip()


def cpu_s() -> float:
    """CPU time of all child processes that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
