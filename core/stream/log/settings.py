"""Settings of a log: a file or folder, its form and limits, and addresses to which the rows are teed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from ...errors import DermisError
from ..links.url import Url

FORMS: Mapping[str, str] = {"csv": ".csv", "binary": ".dlog"}  # form -> suffix of its files
MEGABYTE = 1_000_000
TEE_RATE = 2000.0  # datagrams a second at most, unless the address says otherwise: twice the fastest device [Hz]
TEE_FORMS = ("json", "binary")


@dataclass(frozen=True)
class Tee:
    """Where rows go besides the log.

    Attributes:
        kind: 'udp' or 'lsl'. text: the address as it was given. host, port, form: of UDP. name: of an LSL stream.
        rate: rows a second at most [Hz]; 0: all.
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
            DermisError: it is none, or the package that it needs is not installed.
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
        path: a file that ends in .csv or .dlog, or a folder for files that are named by device and time; '': no file.
        form: 'csv' or 'binary', of files in a folder. size, total: of one file, and of all files of one log [bytes].
        tees: addresses.
    """

    path: str = ""
    form: str = "csv"
    size: float = 0.0
    total: float = 0.0
    tees: tuple[str, ...] = ()

    @property
    def wanted(self) -> bool:
        """Whether anything is to be written or teed."""
        return bool(self.path or self.tees)

    def check(self) -> None:
        """Refuse invalid settings, without touching a file.

        Raises:
            DermisError: less room for all files than for one, another suffix, or an address that is none.
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
        """Return the path of the first file, which must not exist yet, and its form.

        Args:
            device: key of the device. stamp: date and time, for the name of a file in a folder.

        Raises:
            DermisError: the file is there already, or its folder is not there or cannot be made.
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
    """Return settings from a request's fields; `tee` has addresses with blanks between them."""
    return LogSettings(log, form, size, total, tuple(tee.split()))
