"""The command line in a process of its own, forked from one that has read the package already: quicker than a new interpreter."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from multiprocessing import get_context
from pathlib import Path

from massprop_cli.cli import main

_FORKS = get_context("forkserver")
_FORKS.set_forkserver_preload(["massprop_cli.analysis", "massprop_cli.store", "massprop_cli.report.result", "tests.commandline"])


def massprop(folder: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """What ``massprop`` prints and returns, run in ``folder`` without settings of whoever runs the tests."""
    with tempfile.TemporaryDirectory() as kept:
        said = [Path(kept) / name for name in ("stdout", "stderr")]
        process = _FORKS.Process(target=_run, args=(folder, tuple(map(str, arguments)), said))
        process.start()
        process.join(50)
        if process.exitcode is None:
            process.kill()
            raise subprocess.TimeoutExpired(list(map(str, arguments)), 50)
        stdout, stderr = (path.read_text(encoding="utf-8") for path in said)
    return subprocess.CompletedProcess(arguments, process.exitcode, stdout, stderr)


def _run(folder: Path, arguments: tuple[str, ...], said: list[Path]) -> None:
    for key in [key for key in os.environ if key.startswith("MASSPROP_")]:
        del os.environ[key]
    os.environ |= {"COLUMNS": "200", "NO_COLOR": "1", "PYTHONUTF8": "1"}
    os.chdir(folder)
    for descriptor, path in zip((1, 2), said, strict=True):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), descriptor)
    sys.stdout, sys.stderr = (open(descriptor, "w", encoding="utf-8", closefd=False) for descriptor in (1, 2))  # noqa: SIM115
    sys.argv = ["massprop", *arguments]
    main()
