"""Coverage-guided fuzzing by name: ``python -m tests.fuzz csv 3600`` feeds a target of tests/targets.py for so many seconds.

What is new goes into a folder of its own; what ends it (a traceback, more than 10 s, more than 1 GB) is written beside, and belongs into
tests/corpus once it is mended.
"""

from __future__ import annotations

import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["massprop_cli", "tomllib", "json", "csv"]):
    from tests import targets

MEMORY_MB, TIMEOUT_S, LONGEST = 1024, 10, 20_000


def main() -> None:
    name, seconds = sys.argv[1], int(sys.argv[2])
    found = Path("fuzz-out") / name
    found.mkdir(parents=True, exist_ok=True)
    limits = [f"-rss_limit_mb={MEMORY_MB}", f"-timeout={TIMEOUT_S}", f"-max_len={LONGEST}"]
    options = [f"-max_total_time={seconds}", f"-artifact_prefix={found.parent}/{name}-", "-print_final_stats=1", "-verbosity=1"]
    atheris.Setup([sys.argv[0], *limits, *options, str(found), str(targets.CORPUS / name)], targets.TARGETS[name])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
