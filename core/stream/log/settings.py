"""Settings of a log: file or folder, format, size limits and tees.

A tee sends the rows to another program while they are written.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from ...errors import DermisError
from ..links.url import Url

FORMS: Mapping[str, str] = {"csv": ".csv", "binary": ".dlog"}  # format -> suffix of its files
MEGABYTE = 1_000_000  # [bytes]
TEE_RATE = 2000.0  # [Hz] default of the largest rate of datagrams: twice the rate of the fastest device
TEE_FORMS = ("json", "binary")


@dataclass(frozen=True)
class Tee:
    """An address to which rows are sent besides the log.

    Attributes:
        kind: 'udp' or 'lsl'. text: the address as given. host, port, form: host, port and format of UDP datagrams.
        name: name of an LSL stream. rate: largest rate of rows [Hz]; 0: all rows.
    """

    kind: str
    text: str
    host: str = ""
    port: int = 0
    form: str = "json"
    rate: float = TEE_RATE
    name: str = ""

    @classmethod
    def of(cls, text: str) -> Tee:
        """Read an address: udp://HOST:PORT?format=json|binary&rate=HZ, or lsl:NAME.

        Raises:
            DermisError: the address is invalid, or the package that it needs is not installed.
        """
        if text.startswith("lsl:"):
            name = text.removeprefix("lsl:").removeprefix("//")
            if not name:
                raise DermisError("an LSL stream needs a name", where="tee", value=text, limit="lsl:NAME")
            if find_spec("pylsl") is None:
                raise DermisError(
                    "LSL needs the Python package 'pylsl', which is not installed",
                    where="tee",
                    value=text,
                    remedy="Run 'pip install pylsl' with the Python that runs Dermis, or tee to udp://HOST:PORT",
                )
            return cls("lsl", text, name=name, rate=0.0)
        if not text.startswith("udp://"):
            raise DermisError("not an address to tee to", where="tee", value=text, limit="udp://HOST:PORT or lsl:NAME")
        url = Url(text)
        host, port = url.host_port()
        form, given = url.take("format", "json"), url.take("rate", f"{TEE_RATE:g}")
        if form not in TEE_FORMS:
            raise DermisError("no such format of datagrams", where=text, value=form, limit=" or ".join(TEE_FORMS))
        try:
            rate = float(given)
        except ValueError:
            rate = -1.0
        if not 0 <= rate <= 10_000:
            raise DermisError(
                "not a rate of datagrams", where=text, value=given, limit="0 (all) to 10000, a number in Hz"
            )
        if url.options:
            raise DermisError(
                "unknown option of a tee", where=text, value=", ".join(sorted(url.options)), limit="format, rate"
            )
        return cls("udp", text, host, port, form, rate)


@dataclass(frozen=True)
class LogSettings:
    """Settings of a log and its tees.

    Attributes:
        path: a file that ends in .csv or .dlog, or a folder for files named by device and time; '': no file.
        form: format of files in a folder, 'csv' or 'binary'.
        size, total: largest size of one file, and of all files of one log [bytes]. tees: addresses of the tees.
    """

    path: str = ""
    form: str = "csv"
    size: float = 0.0
    total: float = 0.0
    tees: tuple[str, ...] = ()

    @property
    def wanted(self) -> bool:
        """Whether there is a file or a tee."""
        return bool(self.path or self.tees)

    def check(self) -> None:
        """Refuse invalid settings, without touching a file.

        Raises:
            DermisError: `total` is below `size`, the path has another suffix, or a tee is invalid.
        """
        for text in self.tees:
            Tee.of(text)
        if self.path and self.total < self.size:
            raise DermisError(
                "all files of a log together may not be smaller than one of them",
                where="log_total",
                value=f"{self.total / MEGABYTE:g} MB",
                limit=f">= {self.size / MEGABYTE:g} MB (log_size)",
            )
        suffix = Path(self.path).suffix.lower()
        if self.path and suffix and suffix not in FORMS.values() and not Path(self.path).is_dir():
            raise DermisError(
                "a log is a CSV or a binary file",
                where="log",
                value=self.path,
                limit=f"a name that ends in {' or '.join(FORMS.values())}, or a folder",
            )

    def place(self, device: str, stamp: str) -> tuple[Path, str]:
        """Return the path of the first file, and its format.

        The file does not exist yet.

        Args:
            device: key of the device. stamp: date and time, for the name of a file in a folder.

        Raises:
            DermisError: the file exists already, or its folder does not exist or cannot be made.
        """
        path, suffixes = Path(self.path), {suffix: form for form, suffix in FORMS.items()}
        form = suffixes.get(path.suffix.lower(), "")
        if form and not path.is_dir():
            if path.exists() or path.is_symlink():
                raise DermisError(
                    "a log would overwrite a file",
                    where=str(path),
                    remedy="Name a file that does not exist yet, or a folder",
                )
            if not path.parent.is_dir():
                raise DermisError("no such folder", where=str(path.parent), remedy="Make it, or choose another")
            return path, form
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DermisError(
                "the folder of the log cannot be made",
                where=str(path),
                value=error.strerror or str(error),
                remedy="Choose a folder that is writable and has room",
            ) from error
        suffix, number = FORMS[self.form], 1
        while (found := path / f"{device}_{stamp}{f'_{number}' if number > 1 else ''}{suffix}").exists():
            number += 1
        return found, self.form


def settings_of(log: str, form: str, size: float, total: float, tee: str) -> LogSettings:
    """Return settings from a request's fields.

    `tee`: addresses separated by blanks.
    """
    return LogSettings(log, form, size, total, tuple(tee.split()))
