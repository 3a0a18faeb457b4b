"""Worker processes of verbs: on this machine, or those of a scheduler."""

from __future__ import annotations

import argparse
import sys

from ..errors import DermisError
from ..work.executor import JobExecutor
from ..work.processes import ProcessExecutor, cores, serve


def executor_of(options: argparse.Namespace) -> JobExecutor:
    """Return the executor that the options of `arguments.WORKERS` choose.

    Raises:
        DermisError: the number of processes is negative, options contradict each other, some files for TLS are missing,
            or the scheduler cannot be used.
    """
    if options.workers < 0:
        raise DermisError("too small", where="--workers", value=options.workers, limit=">= 0")
    given = [getattr(options, name) for name in ("tls_ca", "tls_cert", "tls_key")]
    if options.scheduler is None:
        if any(given):
            raise DermisError(
                "keys can only be used with a scheduler",
                where="--tls-ca, --tls-cert, --tls-key",
                remedy="Leave them out",
            )
        return ProcessExecutor(options.workers or cores())
    if options.workers:
        raise DermisError("a scheduler has workers of its own", where="--workers", remedy="Leave it or --scheduler out")
    from ..work.cluster import ClusterExecutor, Keys, is_open

    if any(given) and not all(given):
        raise DermisError("TLS needs three files", where="--tls-ca, --tls-cert, --tls-key", remedy="Give all of them")
    keys = Keys(*map(str, given)) if all(given) else None
    executor = ClusterExecutor(options.scheduler, keys)
    if is_open(options.scheduler):
        what = "is neither encrypted nor on this machine: whoever reaches it can run any program on its workers"
        print(f"warning: {options.scheduler} {what}", file=sys.stderr)
    executor.room()
    print(f"{options.scheduler}: {executor.workers} at once", file=sys.stderr)
    return executor


def tell_unlike(executor: JobExecutor) -> None:
    """Print warnings of workers that may compute other last digits.

    The engine of such a worker differs from that of this process.
    """
    for words in sorted(getattr(executor, "unlike", ())):
        print(f"warning: a worker has {words}: results agree with this machine's to some 1e-6", file=sys.stderr)


def work(_options: argparse.Namespace) -> int:
    """Run the jobs that a parent process sends to standard input.

    Return the exit status.
    """
    return serve()
