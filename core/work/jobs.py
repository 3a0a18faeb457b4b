"""Jobs by name: functions from arrays and plain values to arrays.

Nothing is pickled.
"""

from __future__ import annotations

import json
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError

Arrays = Mapping[str, NDArray[Any]]
Report = Callable[[int, int], None]  # called with a job's progress: done, total
Table = Mapping[str, str]

# For each name 'module:function'. The function is called with (arrays, parameters, report) and returns arrays.
JOBS: Table = {
    "skin": ".skin.job:make",
    "skin-files": ".skin.job:make_files",
    "pad": ".skin.job:make_surface",
    "collect": ".design.collect:work",
    "adapt": ".matching.adapt:adapt_job",
    "compare": ".comparison.job:compare_job",
    "share": ".pipeline.share_job:work",
    "share-begin": ".pipeline.share_job:begin",
    "shot": ".pipeline.shot:work",
    "sweep-reading": ".sweep.readings:work",
    "sweep-row": ".sweep.job:work",
    "thimble": ".matching.thimble_job:make",
    "tell-apart": ".comparison.job:tell_job",
}
_CORE = __package__.rpartition(".")[0]


@dataclass(frozen=True)
class Job:
    """A job: its name in a table, arrays, and plain parameters.

    JSON can represent the parameters.

    Raises:
        DermisError: code 'no-such-job': the name is not in the table; 'not-plain': Python objects among the inputs.
    """

    name: str
    arrays: Arrays
    parameters: Mapping[str, Any]
    table: Table

    def __post_init__(self) -> None:
        where = f"job '{self.name}'"
        if self.name not in self.table:
            raise DermisError("no such job", value=self.name, limit=", ".join(self.table), code="no-such-job")
        self._check_arrays(self.arrays)
        try:
            json.dumps(dict(self.parameters))
        except (TypeError, ValueError) as error:
            raise DermisError(
                "parameters must be plain values", where=where, value=str(error), code="not-plain"
            ) from error

    def _check_arrays(self, arrays: Arrays) -> None:
        for name, array in arrays.items():
            if np.asarray(array).dtype.hasobject:
                raise DermisError("an array of Python objects", where=f"job '{self.name}', '{name}'", code="not-plain")

    def run(self, report: Report) -> dict[str, NDArray[Any]]:
        """Run the job in this process and return its arrays.

        Raises:
            DermisError: raised by the job; code 'job-failed' for any other exception, whose traceback is printed.
        """
        module, _, function = self.table[self.name].partition(":")
        try:
            made = getattr(import_module(module, _CORE), function)(self.arrays, self.parameters, report)
            made = {str(name): np.asarray(array) for name, array in made.items()}
        except DermisError:
            raise
        except (Exception, SystemExit) as error:
            traceback.print_exc()
            raise DermisError(
                f"the job failed: {type(error).__name__}",
                where=f"job '{self.name}'",
                value=str(error),
                code="job-failed",
            ) from error
        self._check_arrays(made)
        return made
