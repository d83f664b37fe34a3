"""``python -m website [FOLDER]``: the site into FOLDER, build/site unless another is named."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from website.stage import ROOT, stage


def build(folder: Path) -> int:
    """Zensical's exit code: 0, or another where a page warns or a link leads nowhere, and nothing is written."""
    with tempfile.TemporaryDirectory() as staged:
        configuration = stage(Path(staged))
        command = [sys.executable, "-m", "zensical", "build", "--strict", "--config-file", str(configuration)]
        # Zensical imports website.mathml
        code = subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=False).returncode
        if code == 0:
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(Path(staged) / "site", folder)
    return code


if __name__ == "__main__":
    if any(one.startswith("-") for one in sys.argv[1:]):
        sys.exit("python -m website [FOLDER]: builds the site there (default: build/site)")
    sys.exit(build(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "site"))
