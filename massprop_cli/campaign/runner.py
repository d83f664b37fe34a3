"""Executors of jobs: the interface, and worker processes on this machine, which end with their parent."""

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
"""Number of attempts at a job whose worker process dies."""
_START = "import sys; sys.path[:] = sys.argv[1:]; from massprop_cli.campaign.runner import main; main()"


@dataclass(frozen=True)
class Task:
    """A job with the data that its worker needs."""

    job: Job
    known: str | None = None
    """Fingerprint of the existing result, which the worker does not repeat; None: always process the log."""
    sent: Mapping[str, bytes] | None = None
    """Files that the worker cannot read itself, by location; None: it can read all."""


def cores() -> int:
    """Number of processor cores available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Executor(Protocol):
    """Interface of what runs tasks: local processes or a cluster."""

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Produced | None]]:
        """Yield the index and the result of :func:`work.process` for each task, in the order in which tasks end.

        Each task is yielded once; the result is :func:`work.failed` if its worker is lost. The number of results in memory is limited,
        whatever the number of tasks. Closing the iterator stops running tasks.
        """


class LocalExecutor:
    """``jobs`` processes on this machine; None: one per available core."""

    def __init__(self, jobs: int | None = None) -> None:
        self.jobs = jobs or cores()

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Produced | None]]:
        """See :class:`Executor`."""
        workers = [Worker() for _ in range(min(self.jobs, len(tasks)))]
        idle = queue.SimpleQueue[Worker]()
        for one in workers:
            idle.put(one)

        def run_one(index: int) -> tuple[int, Produced | None]:
            worker = idle.get()
            try:
                return index, worker.work(tasks[index])
            finally:
                idle.put(worker)

        threads = ThreadPoolExecutor(max(len(workers), 1))
        waiting = (threads.submit(run_one, index) for index in range(len(tasks)))
        submitted = deque(islice(waiting, 2 * self.jobs))
        try:
            while submitted:
                first = next(as_completed(submitted))
                submitted.remove(first)
                yield first.result()
                submitted.extend(islice(waiting, 1))
        finally:
            for future in submitted:
                future.cancel()
            for one in workers:
                one.close()
            threads.shutdown()


class Worker:
    """Handle of one worker process, started at its first task and again after a crash."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._guard = threading.Lock()
        self._closed = False

    def work(self, task: Task) -> Produced | None:
        """Run a task in the process; if the process dies, start a new one and repeat, up to :data:`TRIES` attempts."""
        code = None
        for _ in range(TRIES):
            process = self._started()
            if process is None or process.stdin is None or process.stdout is None:
                break
            try:
                pickle.dump(task, process.stdin, pickle.HIGHEST_PROTOCOL)
                process.stdin.flush()
                result: Produced | None = pickle.load(process.stdout)
                return result
            except (EOFError, OSError, ValueError, pickle.UnpicklingError):
                code = self.end()
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        message = f"{task.job.shown}: the process for this log died twice ({how}); is there enough memory? Run the batch again"
        return work.failed(task.job, exits.BUG, message)

    def _started(self) -> subprocess.Popen[bytes] | None:
        """The process, started if necessary; None after :meth:`close`."""
        with self._guard:
            if self._process is None and not self._closed:
                # -I: neither the current folder nor PYTHON* variables affect imports
                # -I also ignores PYTHONDONTWRITEBYTECODE, so -B repeats it
                no_bytecode = ["-B"] if sys.dont_write_bytecode else []
                command = [sys.executable, "-I", *no_bytecode, "-c", _START, *sys.path]
                pipe = subprocess.PIPE
                self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=os.environ | onethread.SETTINGS)
            return self._process

    def close(self) -> None:
        """Stop the process; later tasks fail."""
        with self._guard:
            self._closed = True
        self.end()

    def end(self) -> int | None:
        """Stop the process and return its exit code."""
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
    """Main loop of a worker process: process pickled tasks from stdin until it closes.

    Results go to the original stdout. Anything printed goes to stderr, so that it cannot corrupt them.
    """
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
