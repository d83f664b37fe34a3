"""Where jobs run: here, in worker processes of this machine, which end when their parent does. Others need only :meth:`Executor.run`."""

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from itertools import islice
from typing import Protocol

from massprop_cli.base import exits, onethread
from massprop_cli.base.dataclass import dataclass
from massprop_cli.campaign import work
from massprop_cli.campaign.plan import Job
from massprop_cli.campaign.work import Produced

TRIES = 2
"""How often a job is tried whose worker dies."""
_START = "import sys; sys.path[:] = sys.argv[1:]; from massprop_cli.campaign.runner import main; main()"


@dataclass(frozen=True)
class Task:
    """A job for a worker."""

    job: Job
    known: str | None = None
    """The fingerprint of the result that it has already; None: it has none, or it shall be done anyway."""
    sent: Mapping[str, bytes] | None = None
    """Files that the worker can't read itself, by location; None: it can read all."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Executor(Protocol):
    """Runs tasks somewhere."""

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Produced | None]]:
        """Each task's index with what :func:`work.process` gave for it, in whatever order they end.

        Every task comes out once; one whose worker is lost comes out as :func:`work.failed`. Results not yet taken are few, however many
        the tasks. When the iterator is closed early, what runs is stopped.
        """


class LocalExecutor:
    """``jobs`` processes on this machine; None: as many as it has cores for this process."""

    def __init__(self, jobs: int | None = None) -> None:
        self.jobs = jobs or cores()

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Produced | None]]:
        """See :class:`Executor`."""
        workers = [Worker() for _ in range(min(self.jobs, len(tasks)))]
        idle = queue.SimpleQueue[Worker]()
        for one in workers:
            idle.put(one)

        def done(index: int) -> tuple[int, Produced | None]:
            own = idle.get()
            try:
                return index, own.work(tasks[index])
            finally:
                idle.put(own)

        threads = ThreadPoolExecutor(max(len(workers), 1))
        waiting = (threads.submit(done, index) for index in range(len(tasks)))
        ahead = deque(islice(waiting, 2 * self.jobs))
        try:
            while ahead:
                first = next(as_completed(ahead))
                ahead.remove(first)
                yield first.result()
                ahead.extend(islice(waiting, 1))
        finally:
            for future in ahead:
                future.cancel()
            for one in workers:
                one.close()
            threads.shutdown()


class Worker:
    """One process at a time, started when it is needed."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._guard = threading.Lock()
        self._closed = False

    def work(self, task: Task) -> Produced | None:
        """Run a task in the process; a process that dies is started once more."""
        code = None
        for _ in range(TRIES):
            process = self._started()
            if process is None or process.stdin is None or process.stdout is None:
                break
            try:
                pickle.dump(task, process.stdin, pickle.HIGHEST_PROTOCOL)
                process.stdin.flush()
                found: Produced | None = pickle.load(process.stdout)
                return found
            except (EOFError, OSError, ValueError, pickle.UnpicklingError):
                code = self.end()
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        said = f"{task.job.shown}: the process for this log died twice ({how}); is there enough memory? Run the batch again"
        return work.failed(task.job, exits.BUG, said)

    def _started(self) -> subprocess.Popen[bytes] | None:
        """The process; None once this worker is closed."""
        with self._guard:
            if self._process is None and not self._closed:
                # -I: neither the current folder nor the user's own settings of Python have a say in what is imported
                # which would forget that whoever starts us wants nothing compiled to be kept
                kept = ["-B"] if sys.dont_write_bytecode else []
                command = [sys.executable, "-I", *kept, "-c", _START, *sys.path]
                pipe = subprocess.PIPE
                self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=os.environ | onethread.SETTINGS)
            return self._process

    def close(self) -> None:
        """Stop for good."""
        with self._guard:
            self._closed = True
        self.end()

    def end(self) -> int | None:
        """Stop the process; how it ended."""
        with self._guard:
            process, self._process = self._process, None
        if process is None:
            return None
        process.kill()
        code = process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        return code


def main() -> None:
    """Work until told no more. What anything prints goes to stderr, so that it can't disturb the messages."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    messages = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while True:
        try:
            task = pickle.load(sys.stdin.buffer)
            pickle.dump(work.process(task.job, task.known, task.sent), messages, pickle.HIGHEST_PROTOCOL)
            messages.flush()
        except (EOFError, BrokenPipeError, pickle.UnpicklingError):
            os._exit(0)
