"""The command line in a process of its own, forked from one that has read the package already: quicker than a new interpreter."""

import marshal
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from threading import Thread

from massprop_cli.cli import main

STDIN = "stdin.csv"
"""A file of this name in the folder is standard input."""
_FORKS = get_context("forkserver")
_FORKS.set_forkserver_preload(
    [
        *("massprop_cli.flow", "massprop_cli.job", "massprop_cli.result.store", "massprop_cli.result.schema", "massprop_cli.result.judge"),
        *("massprop_cli.cli.estimate", "massprop_cli.cli.batch", "massprop_cli.cli.report", "massprop_cli.cli.compare"),
        *("massprop_cli.campaign.run", "massprop_cli.campaign.discover", "massprop_cli.campaign.joining", "massprop_cli.campaign.page"),
        *("massprop_cli.campaign.terminal", "massprop_cli.report.html", "massprop_cli.report.terminal", "massprop_cli.report.markdown"),
        *("massprop_cli.check.flow", "massprop_cli.combine.flow", "massprop_cli.plan.flow", "massprop_cli.testbed.output"),
        *("filelock", "jinja2", "importlib.metadata", "rich.console", "rich.table", "rich.progress"),
        *("scipy.optimize", "typer.rich_utils", "matplotlib.figure", "matplotlib.backends.backend_svg"),
        *("matplotlib.backends.backend_agg", "tests.commandline"),
    ]
)
"""What commands import when they are asked for, a tenth of a second each time; forks have it already. Nothing of it may start a thread, as
pyarrow does: what a fork waits for a thread to do that it has not is never done."""


class Done(subprocess.CompletedProcess[str]):
    """A process that has ended."""

    def __init__(self, arguments: Sequence[str | Path], code: int, stdout: str, stderr: str, peak_bytes: int) -> None:
        super().__init__(arguments, code, stdout, stderr)
        self.peak_bytes = peak_bytes
        """Most memory that it held."""


def massprop(folder: Path, *arguments: str | Path, **settings: str) -> Done:
    """What ``massprop`` prints and returns, run in ``folder`` without settings of whoever runs the tests but with these."""
    return ended(folder, arguments, settings)


def succeeded(folder: Path, *arguments: str | Path, **settings: str) -> Done:
    """The same of what must end with 0."""
    done = massprop(folder, *arguments, **settings)
    assert done.returncode == 0, done.stderr
    return done


def ended(
    folder: Path, arguments: Sequence[str | Path], settings: dict[str, str] | None = None, first: Callable[[], None] | None = None
) -> Done:
    """The same; ``first`` is done in its process before all else."""
    with tempfile.TemporaryDirectory() as kept:
        said = [Path(kept) / name for name in ("stdout", "stderr", "peak")]
        process = begun(folder, arguments, said, settings or {}, first)
        process.join(50)
        if process.exitcode is None:
            process.kill()
            raise subprocess.TimeoutExpired(list(map(str, arguments)), 50)
        stdout, stderr, peak = (path.read_text(encoding="utf-8") for path in said)
    return Done(arguments, process.exitcode, stdout, stderr, int(peak))


def begun(
    folder: Path,
    arguments: Sequence[str | Path],
    said: list[Path],
    settings: dict[str, str],
    first: Callable[[], None] | None = None,
) -> ForkServerProcess:
    """The same as it begins; what it says, and its peak of memory, go into the files ``said``. ``first`` is done in it before all else."""
    process = _FORKS.Process(target=_run, args=(folder, tuple(map(str, arguments)), said, settings, first))
    process.start()
    return process


def _run(folder: Path, arguments: tuple[str, ...], said: list[Path], settings: dict[str, str], first: Callable[[], None] | None) -> None:
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("MASSPROP_", "GITHUB_"))}
    streams = [os.open(path, os.O_WRONLY | os.O_CREAT) for path in said[:2]]
    with suppress(FileNotFoundError):
        streams.insert(0, os.open(folder / STDIN, os.O_RDONLY))
    _enter(folder, kept | {"COLUMNS": "200", "NO_COLOR": "1", "PYTHONUTF8": "1"} | settings, streams)
    sys.argv = ["massprop", *arguments]
    if first is not None:
        first()
    try:
        main()
    finally:
        said[2].write_text(str(1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss), encoding="utf-8")


def _enter(folder: str | Path, environment: Mapping[str, str], streams: Sequence[int]) -> None:
    """This process becomes one in ``folder`` with such an environment and such streams: the last two, or all three."""
    os.environ.clear()
    os.environ |= environment
    os.chdir(folder)
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # as massprop_cli.__main__ has it before anything else
    for descriptor, stream in zip((2, 1, 0), reversed(streams), strict=False):
        os.dup2(stream, descriptor)
    if len(streams) == 3:
        sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stdout, sys.stderr = (open(descriptor, "w", encoding="utf-8", closefd=False) for descriptor in (1, 2))  # noqa: SIM115


_TOOL = """#!{python} -SI
import marshal, os, socket, sys
with socket.socket(socket.AF_UNIX) as line:
    line.connect({address!r})
    socket.send_fds(line, [b" "], [0, 1, 2])
    line.sendall(marshal.dumps((os.getcwd(), sys.argv[1:], dict(os.environ))))
    line.shutdown(socket.SHUT_WR)
    sys.exit(int(line.recv(16)))
"""


@contextmanager
def tool(folder: Path) -> Iterator[None]:
    """``folder/massprop``, for scripts that have the folder on their ``PATH``: each call is such a process."""
    with tempfile.TemporaryDirectory() as kept, socket.socket(socket.AF_UNIX) as calls:
        calls.bind(f"{kept}/calls")
        calls.listen()
        (folder / "massprop").write_text(_TOOL.format(python=sys.executable, address=f"{kept}/calls"), encoding="utf-8")
        (folder / "massprop").chmod(0o755)
        thread = Thread(target=_answer, args=(calls,))
        thread.start()
        try:
            yield
        finally:
            calls.shutdown(socket.SHUT_RDWR)
            thread.join()


def _answer(calls: socket.socket) -> None:
    """One call after the other: no script here makes two at a time, or pipes one into another."""
    while True:
        try:
            call, _ = calls.accept()
        except OSError:
            return
        with call:
            _, descriptors, _, _ = socket.recv_fds(call, 1, 3)
            with call.makefile("rb") as said:
                called = marshal.loads(said.read())
            streams = [Connection(one) for one in descriptors]
            process = _FORKS.Process(target=_called, args=(streams, *called))
            process.start()
            # or whoever reads what the process prints waits for ever
            for one in streams:
                one.close()
            process.join()
            call.sendall(str(process.exitcode).encode())


def _called(streams: Sequence[Connection], folder: str, arguments: Sequence[str], environment: Mapping[str, str]) -> None:
    _enter(folder, environment, [one.fileno() for one in streams])
    sys.argv = ["massprop", *arguments]
    main()
