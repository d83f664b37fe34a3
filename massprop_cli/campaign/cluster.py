"""Jobs on a dask.distributed cluster (``pip install 'massprop[cluster]'``): nothing is shared but the scheduler.

Files of this machine go with the task, workers read URLs, results come back as bytes. Each thread of a worker has a process of its own for
the logs (:mod:`massprop_cli.campaign.runner`); the scheduler runs the logs of a lost worker again.
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
"""Seconds to wait for the scheduler, for a first worker, and for another one where all are lost."""
PER_THREAD = 2
"""Logs in flight for each thread of the workers, so that none waits for its next."""
MOST_BYTES = 256 * 2**20
"""Of files that go with tasks in flight; the scheduler holds them in memory."""
_LOOK_S = 1.0
_of_thread = threading.local()


@dataclass(frozen=True)
class Differs:
    """A worker's answer where it would not give the same bytes: its versions."""

    versions: Mapping[str, str]


def on_worker(task: Task, versions: Mapping[str, str]) -> Produced | Differs | None:
    """Run a task on a thread of a dask worker. It never raises: the client could not unpickle every error."""
    try:
        own = work.versions(task.job.settings.report)
        if own != versions:
            return Differs(own)
        if not hasattr(_of_thread, "worker"):
            _of_thread.worker = Worker()
        worker: Worker = _of_thread.worker
        return worker.work(task)
    except Exception as error:
        return work.failed(task.job, exits.BUG, f"{task.job.shown}: the worker failed ({type(error).__name__}: {error})")


class ClusterExecutor:
    """The workers of the scheduler at ``address``, however many, as they come and go."""

    def __init__(self, address: str) -> None:
        self.address = address

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Produced | None]]:
        """See :class:`massprop_cli.campaign.runner.Executor`; :class:`InputError` where the cluster can't be used, or is lost."""
        with _connected(self.address) as client:
            _check_versions(client, self.address, any(task.job.settings.report for task in tasks))
            yield from _Flight(client, self.address, tasks).results()


class _Flight:
    """The tasks of one run."""

    def __init__(self, client: Any, address: str, tasks: Sequence[Task]) -> None:
        self._client = client
        self._address = address
        self._tasks = tasks
        self._done: queue.Queue[Any] = queue.Queue()
        self._flying: dict[str, tuple[int, int, Any]] = {}
        """By key: the task's index, the bytes that went with it, its future."""

    def results(self) -> Iterator[tuple[int, Produced | None]]:
        ready = _prepared(self._tasks)
        following = next(ready, None)
        while following is not None or self._flying:
            while following is not None and self._has_room(following[1]):
                index, task, produced = following
                if task is None:
                    yield index, produced
                else:
                    self._submit(index, task)
                following = next(ready, None)
            if self._flying:
                future = self._await()
                index, _, _ = self._flying.pop(future.key)
                yield index, self._taken(future, self._tasks[index])

    def _has_room(self, task: Task | None) -> bool:
        """Whether to send one more; one may be as large as it likes."""
        if task is None or not self._flying:
            return True
        flying = sum(size for _, size, _ in self._flying.values())
        return len(self._flying) < PER_THREAD * max(self._threads(), 1) and flying + _size(task) <= MOST_BYTES

    def _threads(self) -> int:
        """The number of threads of all workers; :class:`InputError` where the scheduler does not answer."""
        try:
            return sum(self._client.nthreads().values())
        except Exception:
            raise _lost(self._address) from None

    def _submit(self, index: int, task: Task) -> None:
        with warnings.catch_warnings():
            # the log is in the task because scattered data would be lost with its worker
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
            future = self._client.submit(on_worker, task, work.versions(task.job.settings.report), pure=False)
        self._flying[future.key] = index, _size(task), future
        future.add_done_callback(self._done.put)

    def _await(self) -> Any:
        """The future of the next task that ends."""
        idle_s = 0.0
        while True:
            with suppress(queue.Empty):
                return self._done.get(timeout=_LOOK_S)
            idle_s = 0.0 if self._threads() else idle_s + _LOOK_S
            if idle_s >= NO_WORKER_S:
                raise InputError(f"cluster {self._address}: no worker is left; {_start(self._address)}. What is done stays; run again")

    def _taken(self, future: Any, task: Task) -> Produced | None:
        from distributed import KilledWorker

        try:
            found: Produced | Differs | None = future.result()
        except KilledWorker:
            said = f"{task.job.shown}: each worker that tried it was lost; do the workers have enough memory? Run the batch again"
            return work.failed(task.job, exits.BUG, said)
        except Exception as error:
            if future.status in ("cancelled", "lost") or self._client.status != "running":
                raise _lost(self._address) from None
            said = f"{task.job.shown}: the worker failed ({type(error).__name__}: {error}); do all workers have the same massprop?"
            return work.failed(task.job, exits.BUG, said)
        finally:
            future.release()
        if isinstance(found, Differs):
            raise _other_versions(self._address, "a worker", found.versions, work.versions(task.job.settings.report))
        return found


def _prepared(tasks: Sequence[Task]) -> Iterator[tuple[int, Task | None, Produced | None]]:
    """Each task with this machine's files, one by one; no task where the outcome is known already."""
    for index, task in enumerate(tasks):
        try:
            sent = work.own_files(task.job)
            # whether what was done still holds, as far as that can be told without a worker
            whole = task.known is not None and task.job.log in sent
            unchanged = whole and work.fingerprint(task.job, work.gather(task.job, sent)) == task.known
            yield index, None if unchanged else replace(task, sent=sent), None
        except InputError as error:
            yield index, None, work.failed(task.job, exits.INPUT, str(error))


def _size(task: Task) -> int:
    return sum(len(content) for content in (task.sent or {}).values())


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    try:
        import distributed
        from distributed.comm import resolve_address
    except ImportError:
        raise InputError(f"cluster {address}: needs the package distributed; {EXTRA}") from None
    try:
        resolve_address(address)  # raises for what is no address; a client would take 20 s more to go away
        with _quiet():
            client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError, RuntimeError) as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"cluster {address}: no scheduler answers ({said}); start one with dask scheduler, or correct the address"
        ) from None
    with _quiet():
        try:
            yield client
        finally:
            # also cancels what still runs
            with suppress(Exception):
                client.close(timeout=CONNECT_S)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the log of distributed; its relevant errors become errors of massprop."""
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
    """Refuse workers, and a scheduler, that lack massprop or have another one; what joins later is asked with each task."""
    from importlib import metadata

    try:
        client.wait_for_workers(1, timeout=FIRST_WORKER_S)
    except TimeoutError:
        raise InputError(f"cluster {address}: the scheduler has no workers; {_start(address)}") from None
    expected = work.versions(report)
    # a function of the standard library is there whatever is installed
    try:
        answers = {"the scheduler": client.run_on_scheduler(metadata.version, "massprop")}
    except metadata.PackageNotFoundError:
        answers = {"the scheduler": None}
    answers |= client.run(metadata.version, "massprop", on_error="return")
    for place, answer in answers.items():
        if not isinstance(answer, str):
            said = f"massprop {expected['massprop']} is not installed on {place}"
            raise InputError(f"cluster {address}: {said}; install it there: pip install 'massprop[cluster]=={expected['massprop']}'")
    for place, found in client.run(work.versions, report, on_error="return").items():
        if found != expected:
            raise _other_versions(address, place, found if isinstance(found, dict) else {}, expected)


def _other_versions(address: str, place: str, found: Mapping[str, str], expected: Mapping[str, str]) -> InputError:
    differing = [
        f"{name} {found.get(name, 'unknown')} (here {version})" for name, version in expected.items() if found.get(name) != version
    ]
    said = f"{place} has {', '.join(differing)}, so results would differ from those of this machine"
    return InputError(f"cluster {address}: {said}; install the same versions there, massprop=={expected['massprop']} among them")


def _lost(address: str) -> InputError:
    return InputError(
        f"cluster {address}: the scheduler is lost; start it again. What is done stays, and the same command goes on from there"
    )


def _start(address: str) -> str:
    return f"start one: dask worker {address}"
