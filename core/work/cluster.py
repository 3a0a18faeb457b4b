"""ClusterExecutor: jobs by the workers of a dask scheduler.

The workers can be on other machines. dask transports only texts and bytes. A function is sent by its name, so scheduler
and workers need this engine under the same package name. Large arrays are identified by a hash of their content and
sent to each worker once. If a worker dies, the scheduler gives its jobs to others, until more than
`distributed.scheduler.allowed-failures` workers (by default 3) have died during the same job. A job reports no
progress. A running job cannot be stopped: after `cancel` it continues, and its result is dropped.

dask is optional. It is imported only when a `ClusterExecutor` is made, and never inside Blender.
"""

from __future__ import annotations

import hashlib
import ipaddress
import threading
import time
import uuid
import weakref
from collections.abc import Callable, Mapping
from concurrent.futures import CancelledError, InvalidStateError
from concurrent.futures import wait as wait_for
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from .child import close_at_exit
from .engine import check_same, engine, unlike
from .executor import JobExecutor, JobFuture
from .jobs import JOBS, Arrays, Job, Table
from .parcel import packed, unpacked

LARGE = 1 << 16  # [bytes] size from which an array is sent separately; sending it costs more than an additional task
CONNECT_SECONDS = 15.0  # [s] longest wait for a scheduler
SETTLE_SECONDS = 5.0  # [s] longest wait for cancelled jobs
LOOK_SECONDS = 2.0  # [s] shortest interval between two queries for the number of workers
AHEAD = 2  # submitted jobs for each thread of a worker: one runs, one waits

# A worker with several threads runs one job at a time, because the memory of its process is limited.
_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class Keys:
    """Files of a TLS connection.

    They are the authority's certificate, the client's certificate, and the key of the latter.
    """

    authority: str
    certificate: str
    key: str


def work(request: bytes, *large: bytes) -> bytes:
    """Run a job on a worker; a `DermisError` is returned as a reply as well.

    Args:
        request: bytes of the job, see `ClusterExecutor.submit`.
        large: arrays that were sent separately, in the order named in the request.
    """
    return serve(request, large, JOBS)


def serve(request: bytes, large: tuple[bytes, ...], table: Table) -> bytes:
    """Run a job of a table; see `work`."""
    told = dict(engine())
    try:
        head, arrays = unpacked(request, "a job")
        check_same(head["engine"], "whoever asked this worker")
        for name, data in zip(head["large"], large, strict=True):
            arrays[name] = unpacked(data, f"'{name}' of a job")[1]["array"]
        with _one_at_a_time:
            made = Job(head["job"], arrays, head["parameters"], table).run(lambda _done, _total: None)
        return packed({"engine": told}, made)
    except DermisError as error:
        return packed({"engine": told, "error": error.as_dict()}, {})


def hold(data: bytes) -> bytes:
    """Return an array's bytes, to be kept by a worker for jobs that need it.

    Because this is a task, the scheduler runs it again if the worker dies.
    """
    return data


def tell() -> dict[str, str]:
    """Return the engine of a worker."""
    return dict(engine())


class ClusterExecutor(JobExecutor):
    """Executor that runs jobs on all current workers of a dask scheduler.

    Args:
        address: address of the scheduler, such as 'tcp://127.0.0.1:8786', or 'tls://...' with keys.
        keys: keys of a TLS connection.
        table: names of the jobs.
        entry: entry point of the workers, sent by its name.

    Raises:
        DermisError: code 'no-dask' if dask is not installed; 'no-scheduler' if no scheduler answers; 'other-version' if
            a worker has another engine. Also if there are keys without tls://, or tls:// without keys.
    """

    shares_files = False

    def __init__(
        self, address: str, keys: Keys | None = None, *, table: Table = JOBS, entry: Callable[..., bytes] = work
    ) -> None:
        super().__init__(1, table=table)
        self.address, self._entry = address, entry
        self._client: Any = _connected(address, keys)
        self._lock = threading.Lock()
        self._open: set[JobFuture] = set()
        self._large: dict[str, tuple[Any, int]] = {}  # by hash: dask's future, and the number of jobs that need it
        self._hashes: dict[int, tuple[weakref.ref[NDArray[Any]], str]] = {}  # hashes of living arrays, by id
        self._looked = -LOOK_SECONDS
        self._closed = False
        self.unlike: set[str] = set()  # differences of workers that may change last digits, in words
        close_at_exit(self)
        try:
            for where, theirs in self._ask(tell).items():
                check_same(theirs, f"worker {where}")
                self._note(theirs)
        except BaseException:
            self.close()
            raise

    def __repr__(self) -> str:
        return f"ClusterExecutor({self.address}, {self.room() // AHEAD} at once)"

    def room(self) -> int:
        """Return how many jobs should be submitted at once.

        It is `AHEAD` for each thread of all current workers.
        """
        if time.monotonic() - self._looked > LOOK_SECONDS:
            threads = self._client.scheduler_info(n_workers=-1)["workers"].values()
            self.workers = max(1, sum(int(worker["nthreads"]) for worker in threads))
            self._looked = time.monotonic()
        return AHEAD * self.workers

    def submit(  # type: ignore[override]
        self, name: str, arrays: Arrays | None = None, parameters: Mapping[str, Any] | None = None
    ) -> JobFuture:
        """See `JobExecutor.submit`.

        Files that parameters name must be accessible to the workers.

        Raises:
            DermisError: code 'no-scheduler': the scheduler has gone.
        """
        job, future = Job(name, arrays or {}, parameters or {}, self.table), JobFuture()
        if self._closed:
            raise RuntimeError("cannot schedule new futures after shutdown")
        if self._client.status != "running":  # unfinished jobs are already lost
            remedy = "Start it and its workers again, and do the work once more"
            raise DermisError("the scheduler has gone", where=self.address, remedy=remedy, code="no-scheduler")
        large = {n: a for n, a in job.arrays.items() if np.asarray(a).nbytes >= LARGE}
        head = {"job": name, "parameters": dict(job.parameters), "engine": dict(engine()), "large": list(large)}
        request = packed(head, {n: a for n, a in job.arrays.items() if n not in large})
        held = [self._held(array) for array in large.values()]
        key = f"dermis-{name}-{uuid.uuid4().hex}"
        theirs = self._client.submit(self._entry, request, *(self._large[h][0] for h in held), key=key, pure=False)
        future.set_running_or_notify_cancel()
        with self._lock:
            self._open.add(future)
        future.add_done_callback(partial(self._left, held))
        future.ends_by(partial(self._drop, future, theirs))
        theirs.add_done_callback(partial(self._settle, future))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Refuse new jobs, and disconnect from the scheduler.

        Args:
            wait: whether to wait until all jobs are finished and then disconnect. If it is False, the connection stays
                open.
            cancel_futures: whether to drop the jobs. Jobs that run on workers continue to their end.
        """
        self._closed = True
        with self._lock:
            left = list(self._open)
        for future in left if cancel_futures else ():
            future.cancel()
        if wait:
            wait_for(left, SETTLE_SECONDS if cancel_futures else None)
            self._client.close()

    def close(self) -> None:
        """Drop the jobs and disconnect from the scheduler."""
        self.shutdown(cancel_futures=True)

    def _ask(self, what: Callable[[], dict[str, str]]) -> dict[str, dict[str, str]]:
        try:
            return dict(self._client.run(what))
        except Exception as error:
            raise _failed(error, f"a worker of {self.address}") from error

    def _note(self, theirs: Mapping[str, str]) -> None:
        if words := unlike(theirs):
            self.unlike.add(words)

    def _held(self, array: NDArray[Any]) -> str:
        """Send an array to the workers and return its hash.

        A worker keeps the array as long as a job needs it. A read-only array is hashed only once, for all jobs
        that need it.
        """
        known, data = self._hashes.get(id(array)), b""
        if known is not None and known[0]() is array:
            key = known[1]
        else:
            data = packed({}, {"array": array})
            key = hashlib.sha256(data).hexdigest()
            if not array.flags.writeable:
                self._hashes[id(array)] = weakref.ref(array), key
        with self._lock:
            theirs, users = self._large.get(key, (None, 0))
            if theirs is None:
                data = data or packed({}, {"array": array})
                # A new key each time: dask may still be releasing an earlier task for the same array.
                theirs = self._client.submit(hold, data, key=f"dermis-array-{key[:16]}-{uuid.uuid4().hex}")
            self._large[key] = theirs, users + 1
        return key

    def _left(self, held: list[str], future: JobFuture) -> None:
        """Forget a job, and release the arrays that no other job needs."""
        with self._lock:
            self._open.discard(future)
            for key in held:
                theirs, users = self._large[key]
                if users > 1:
                    self._large[key] = theirs, users - 1
                else:
                    del self._large[key]

    def _drop(self, future: JobFuture, theirs: Any) -> None:
        """Cancel a job, whether or not its scheduler is still there."""
        with suppress(Exception):
            theirs.cancel()
        with suppress(InvalidStateError):  # the job has just ended
            future.fail(CancelledError())

    def _settle(self, future: JobFuture, theirs: Any) -> None:
        """Set the result of a job from dask's future; a thread of dask calls this."""
        with suppress(InvalidStateError):  # the job was dropped meanwhile
            self._give(future, theirs)
        future.ends_by(None)

    def _give(self, future: JobFuture, theirs: Any) -> None:
        try:
            head, made = unpacked(theirs.result(), "a worker's reply")
            self._note(head["engine"])
            if "error" in head:
                raise DermisError(**head["error"])
            future.set_result(made)
        except DermisError as error:
            future.fail(error)
        except (Exception, CancelledError) as error:
            future.fail(_failed(error, f"a worker of {self.address}"))


def _connected(address: str, keys: Keys | None) -> Any:
    """Connect to a scheduler and return dask's client."""
    if (keys is not None) != (urlsplit(address).scheme == "tls"):
        raise DermisError(
            "TLS needs both an address tls://... and the three files of its keys",
            where="--scheduler",
            value=address,
            remedy="Give --tls-ca, --tls-cert and --tls-key with tls://, and none of them with tcp://",
        )
    try:
        import dask
        from distributed import Client, Security
    except ModuleNotFoundError as error:
        raise DermisError(
            "this needs dask.distributed, which this Python does not have",
            where="--scheduler",
            value=str(error.name),
            remedy='Install it: python -m pip install "dermis[dask]"',
            code="no-dask",
        ) from error
    security = None
    if keys is not None:
        files = {"tls_ca_file": keys.authority, "tls_client_cert": keys.certificate, "tls_client_key": keys.key}
        security = Security(**files, require_encryption=True)
    dask.config.set({"distributed.admin.large-graph-warning-threshold": "2GiB"})  # scenes are large, but sent once
    try:
        return Client(address, security=security, timeout=CONNECT_SECONDS, set_as_default=False)
    except Exception as error:
        raise DermisError(
            "no scheduler answers",
            where=address,
            value=" ".join(str(error).split())[:200] or type(error).__name__,
            remedy="Start one (dask scheduler), or correct the address or the keys",
            code="no-scheduler",
        ) from error


def _failed(error: BaseException, where: str) -> DermisError:
    """Return the error for a job without a result, from dask's own exception."""
    said = " ".join(str(error).split())[:300]
    if isinstance(error, ImportError) or isinstance(error.__cause__, ImportError):
        what, code = "a worker, or the scheduler, does not find this engine", "no-engine"
        remedy = "Install it there under the same name (dermis or core), or start the worker where it can be imported"
    elif isinstance(error, CancelledError):
        what, code, remedy = "the scheduler lost the job", "job-crashed", "Start it again, and do the work once more"
    elif type(error).__name__ == "KilledWorker":
        what, code = "workers died of the job", "job-crashed"
        remedy = "Look at their logs; give workers more memory (dask worker --memory-limit)"
    else:
        what, code, remedy = f"the job failed: {type(error).__name__}", "job-failed", ""
    return DermisError(what, where=where, value=said, remedy=remedy, code=code)


def is_open(address: str) -> bool:
    """Return whether others on the network can listen to an address.

    They cannot if it uses TLS or is on this machine.
    """
    parts = urlsplit(address)
    if parts.scheme in ("tls", "inproc"):
        return False
    try:
        return not ipaddress.ip_address(parts.hostname or "").is_loopback
    except ValueError:
        return parts.hostname != "localhost"
