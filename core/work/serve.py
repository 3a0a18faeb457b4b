"""The worker's side: `python -m core work` takes jobs as JSON lines from its parent pipe and replies in JSON lines."""

from __future__ import annotations

import json
import os
import queue
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import DermisError
from ..files import write_npz
from .child import follow_parent
from .jobs import JOBS, Job, Table


def serve(table: Table = JOBS) -> int:
    """Do one job after the other; when the parent has gone, end at once, in the middle of a job too."""
    replies = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what anything prints goes to the log, not between the replies
    requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    follow_parent(lambda: os._exit(0), requests.put)
    while True:
        request = json.loads(requests.get())
        try:
            _do(request, table, replies)
        except DermisError as error:
            _reply(replies, {"error": error.as_dict()})
        else:
            _reply(replies, {"done": True})


def _do(request: Mapping[str, Any], table: Table, replies: BinaryIO) -> None:
    with np.load(request["in"], allow_pickle=False) as loaded:
        job = Job(request["job"], {k: loaded[k] for k in loaded.files}, request["parameters"], table)
    made = job.run(lambda done, total: _reply(replies, {"progress": [done, total]}))
    write_npz(Path(request["out"]), made)


def _reply(replies: BinaryIO, message: Mapping[str, Any]) -> None:
    replies.write(json.dumps(message).encode() + b"\n")
