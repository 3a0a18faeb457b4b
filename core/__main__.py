"""The command line, `python -m core VERB`.

It calls the function of the verb, and turns exceptions into an exit status.
"""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Sequence
from importlib import import_module

if __name__ == "__main__":  # before numpy loads; see skin/blas.py
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from .command_line.messages import REFUSED
from .command_line.verbs import parser, renamed
from .errors import DermisError
from .files import check_folder, check_writable

# Libraries that the extension contains and another Python may lack: module -> name of the package that pip installs.
LIBRARIES = {
    "scipy": "scipy",
    "threadpoolctl": "threadpoolctl",
    "onnxruntime": "onnxruntime",
    "serial": "pyserial",
    "PIL": "pillow",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status.

    The status is that of the verb: 0 for success, and for most verbs 1 if a finding has the severity error. It is 2 if
    the verb was refused, and 130 after Ctrl-C.

    Args:
        arguments: arguments of the command line; None for those of this process.
    """
    options = parser(f"python -m {__package__}").parse_args(renamed(sys.argv[1:] if arguments is None else arguments))
    for stream in (sys.stdout, sys.stderr):  # names may have characters that the terminal cannot show
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        if getattr(options, "presets", None) is not None:  # many verbs have this option
            check_folder(options.presets)
        for name, is_folder in options.writes.items():  # checked before the work begins
            if getattr(options, name) is not None:
                check_writable(getattr(options, name), folder=is_folder)
        module, _, function = options.run.rpartition(".")
        return int(getattr(import_module(f"{__package__}.{module}"), function)(options))
    except DermisError as error:
        if getattr(options, "json", False):
            print(json.dumps({"error": error.as_dict()}, indent=1, ensure_ascii=False))
        print(f"error: {error}", file=sys.stderr)
        return REFUSED
    except ModuleNotFoundError as error:
        package = LIBRARIES.get(str(error.name).partition(".")[0])
        if package is None:
            raise
        print(
            f"error: this needs {error.name}, which this Python ({sys.executable}) does not have; "
            f"install it: {sys.executable} -m pip install {package}",
            file=sys.stderr,
        )
        return REFUSED
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return REFUSED


if __name__ == "__main__":
    sys.exit(main())
