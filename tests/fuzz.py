"""Coverage-guided fuzzing by name: ``python -m tests.fuzz csv 3600`` feeds a target of tests/targets.py for so many seconds.

What is new goes into a folder of its own; what ends it (a traceback, more than 10 s of a processor, more than 1 GB) is written beside,
and belongs into tests/corpus once it is corrected.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["massprop_cli", "tomllib", "json", "csv"]):
    from tests import targets

MEMORY_MB, TIMEOUT_S, LONGEST = 1024, 10, 30_000
STARVED_S = 600
"""By the clock a machine that others use may take that long over what takes ten seconds of a processor."""


def timed(target: Callable[[bytes], None]) -> Callable[[bytes], None]:
    """The target, which fails where it takes too long of a processor."""

    def run(data: bytes) -> None:
        began = time.process_time()
        target(data)
        assert time.process_time() - began < TIMEOUT_S

    return run


def main() -> None:
    name, seconds = sys.argv[1], int(sys.argv[2])
    found = Path("fuzz-out") / name
    found.mkdir(parents=True, exist_ok=True)
    limits = [f"-rss_limit_mb={MEMORY_MB}", f"-timeout={STARVED_S}", f"-max_len={LONGEST}"]
    options = [f"-max_total_time={seconds}", f"-artifact_prefix={found.parent}/{name}-", "-print_final_stats=1", "-verbosity=1"]
    atheris.Setup([sys.argv[0], *limits, *options, str(found), str(targets.CORPUS / name)], timed(targets.TARGETS[name]))
    atheris.Fuzz()


if __name__ == "__main__":
    main()
