"""Jobs on a dask.distributed cluster (``pip install 'massprop[cluster]'``), without a shared file system.

Each task contains the files that only the client can read. Workers read URLs, and return results as bytes. Each worker thread runs its logs
in a separate process (:mod:`massprop_cli.campaign.runner`). The scheduler repeats the logs of a lost worker.
"""

import logging
import queue
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

from massprop_cli.base import exits
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.campaign import work
from massprop_cli.campaign.runner import Task, Worker
from massprop_cli.campaign.work import Produced

EXTRA = "pip install 'massprop[cluster]'"
CONNECT_S, FIRST_WORKER_S, NO_WORKER_S = 10.0, 10.0, 60.0
"""Longest waits, s: for the scheduler, for a first worker, and for a new worker after all were lost."""
PER_THREAD = 2
"""Submitted tasks per worker thread, so that no thread idles between tasks."""
MOST_BYTES = 256 * 2**20
"""Largest total size of the files in submitted tasks, bytes; the scheduler keeps them in memory."""
_POLL_S = 1.0
"""Time between two checks that workers exist, s."""
_of_thread = threading.local()


@dataclass(frozen=True)
class Differs:
    """Answer of a worker whose software versions differ, so that its results would."""

    versions: Mapping[str, str]


def on_worker(task: Task, versions: Mapping[str, str]) -> Produced | Differs | None:
    """Run a task on a thread of a dask worker. It returns errors as outcomes, since the client cannot unpickle every exception."""
    try:
        installed = work.versions(task.job.settings.report)
        if installed != versions:
            return Differs(installed)
        if not hasattr(_of_thread, "worker"):
            _of_thread.worker = Worker()
        worker: Worker = _of_thread.worker
        return worker.work(task)
    except Exception as error:
        return work.failed(task.job, exits.BUG, f"{task.job.shown}: the worker failed ({type(error).__name__}: {error})")


class ClusterExecutor:
    """The workers of the scheduler at ``address``; their number may change during a run."""

    def __init__(self, address: str) -> None:
        self.address = address

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Produced | None]]:
        """See :class:`massprop_cli.campaign.runner.Executor`; raise :class:`InputError` if the cluster is unusable or lost."""
        with _connected(self.address) as client:
            _check_versions(client, self.address, any(task.job.settings.report for task in tasks))
            yield from _ClusterRun(client, self.address, tasks).results()


class _ClusterRun:
    """The tasks of one run, submitted as workers become free."""

    def __init__(self, client: Any, address: str, tasks: Sequence[Task]) -> None:
        self._client = client
        self._address = address
        self._tasks = tasks
        self._done: queue.Queue[Any] = queue.Queue()
        self._submitted: dict[str, tuple[int, int, Any]] = {}
        """Tasks without a result, by key: index of the task, size of its files in bytes, its future."""

    def results(self) -> Iterator[tuple[int, Produced | None]]:
        prepared = _prepared(self._tasks)
        following = next(prepared, None)
        while following is not None or self._submitted:
            while following is not None and self._has_room(following[1]):
                index, task, produced = following
                if task is None:
                    yield index, produced
                else:
                    self._submit(index, task)
                following = next(prepared, None)
            if self._submitted:
                future = self._await()
                index, _, _ = self._submitted.pop(future.key)
                yield index, self._result(future, self._tasks[index])

    def _has_room(self, task: Task | None) -> bool:
        """Whether the limits allow one more task; a single task may have any size."""
        if task is None or not self._submitted:
            return True
        submitted_bytes = sum(size for _, size, _ in self._submitted.values())
        return len(self._submitted) < PER_THREAD * max(self._threads(), 1) and submitted_bytes + _size(task) <= MOST_BYTES

    def _threads(self) -> int:
        """The number of threads of all workers; raise :class:`InputError` if the scheduler does not answer."""
        try:
            return sum(self._client.nthreads().values())
        except Exception:
            raise _lost(self._address) from None

    def _submit(self, index: int, task: Task) -> None:
        with warnings.catch_warnings():
            # the task contains the log: dask would lose scattered data with the worker that holds them
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
            future = self._client.submit(on_worker, task, work.versions(task.job.settings.report), pure=False)
        self._submitted[future.key] = index, _size(task), future
        future.add_done_callback(self._done.put)

    def _await(self) -> Any:
        """Wait for the next task that ends; raise :class:`InputError` after :data:`NO_WORKER_S` without a worker."""
        idle_s = 0.0
        while True:
            with suppress(queue.Empty):
                return self._done.get(timeout=_POLL_S)
            idle_s = 0.0 if self._threads() else idle_s + _POLL_S
            if idle_s >= NO_WORKER_S:
                raise InputError(f"cluster {self._address}: no worker is left; {_start(self._address)}. What is done stays; run again")

    def _result(self, future: Any, task: Task) -> Produced | None:
        """The result of a task that ended; a failure of its worker is an outcome."""
        from distributed import KilledWorker

        try:
            result: Produced | Differs | None = future.result()
        except KilledWorker:
            message = f"{task.job.shown}: each worker that tried it was lost; do the workers have enough memory? Run the batch again"
            return work.failed(task.job, exits.BUG, message)
        except Exception as error:
            if future.status in ("cancelled", "lost") or self._client.status != "running":
                raise _lost(self._address) from None
            message = f"{task.job.shown}: the worker failed ({type(error).__name__}: {error}); do all workers have the same massprop?"
            return work.failed(task.job, exits.BUG, message)
        finally:
            future.release()
        if isinstance(result, Differs):
            raise _other_versions(self._address, "a worker", result.versions, work.versions(task.job.settings.report))
        return result


def _prepared(tasks: Sequence[Task]) -> Iterator[tuple[int, Task | None, Produced | None]]:
    """Each index with its task and the client's files, or without a task and with its outcome (None: the kept result is valid)."""
    for index, task in enumerate(tasks):
        try:
            sent = work.local_files(task.job)
            # compare fingerprints here if this machine has all inputs, so that unchanged logs need no worker
            has_inputs = task.known is not None and task.job.log in sent
            unchanged = has_inputs and work.fingerprint(task.job, work.gather(task.job, sent)) == task.known
            yield index, None if unchanged else replace(task, sent=sent), None
        except InputError as error:
            yield index, None, work.failed(task.job, exits.INPUT, str(error))


def _size(task: Task) -> int:
    """Size of the files in a task, bytes."""
    return sum(len(content) for content in (task.sent or {}).values())


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    """A dask client; raise :class:`InputError` without the package or a scheduler."""
    try:
        import distributed
        from distributed.comm import resolve_address
    except ImportError:
        raise InputError(f"cluster {address}: needs the package distributed; {EXTRA}") from None
    try:
        resolve_address(address)  # reports an invalid address at once; a client would take 20 s to close
        with _quiet():
            client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError, RuntimeError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"cluster {address}: no scheduler answers ({reason}); start one with dask scheduler, or correct the address"
        ) from None
    with _quiet():
        try:
            yield client
        finally:
            # this also cancels running tasks
            with suppress(Exception):
                client.close(timeout=CONNECT_S)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the loggers of distributed; massprop reports its errors itself."""
    loggers = [logger for name, logger in logging.root.manager.loggerDict.items() if name.startswith("distributed")]
    levels = [(logger, logger.level) for logger in loggers if isinstance(logger, logging.Logger)]
    for logger, _ in levels:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in levels:
            logger.setLevel(level)


def _check_versions(client: Any, address: str, report: bool) -> None:
    """Raise :class:`InputError` if workers or scheduler lack massprop or have another version; each task checks again on its worker."""
    from importlib import metadata

    try:
        client.wait_for_workers(1, timeout=FIRST_WORKER_S)
    except TimeoutError:
        raise InputError(f"cluster {address}: the scheduler has no workers; {_start(address)}") from None
    expected = work.versions(report)
    # first call a function of the standard library: every Python has it
    try:
        answers = {"the scheduler": client.run_on_scheduler(metadata.version, "massprop")}
    except metadata.PackageNotFoundError:
        answers = {"the scheduler": None}
    answers |= client.run(metadata.version, "massprop", on_error="return")
    for place, answer in answers.items():
        if not isinstance(answer, str):
            problem = f"massprop {expected['massprop']} is not installed on {place}"
            raise InputError(f"cluster {address}: {problem}; install it there: pip install 'massprop[cluster]=={expected['massprop']}'")
    for place, installed in client.run(work.versions, report, on_error="return").items():
        if installed != expected:
            raise _other_versions(address, place, installed if isinstance(installed, dict) else {}, expected)


def _other_versions(address: str, place: str, installed: Mapping[str, str], expected: Mapping[str, str]) -> InputError:
    differing = [
        f"{name} {installed.get(name, 'unknown')} (here {version})" for name, version in expected.items() if installed.get(name) != version
    ]
    problem = f"{place} has {', '.join(differing)}, so results would differ from those of this machine"
    return InputError(f"cluster {address}: {problem}; install the same versions there, massprop=={expected['massprop']} among them")


def _lost(address: str) -> InputError:
    return InputError(
        f"cluster {address}: the scheduler is lost; start it again. What is done stays, and the same command goes on from there"
    )


def _start(address: str) -> str:
    return f"start one: dask worker {address}"
