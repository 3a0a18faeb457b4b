"""Reports of which touches can be told apart.

They are text, CSV and plain JSON values.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..files import write_bytes
from ..track.file_names import FileNames, safe
from ..version import version
from .aligned import aligned
from .ideal_observer import Answer
from .told_apart import Told

NOTE = (
    "Simulated: an ideal observer who reads every SA I and FA I afferent of the pad, and wastes nothing. 'right' is "
    "how often one who knows the real touches is right in a choice of two, 50 % is guessing; d' counts any difference."
)
REAL = "the real touches"


def lines(found: Told) -> list[tuple[str, ...]]:
    """Return the table as text.

    It has a heading, a row for the real touches, and a row for each device and method; one column for each pair.
    """
    heads = tuple(f"{i + 1} or {j + 1}" for i, j in found.pairs)
    rows = [("device", "method", *heads), (REAL, "", *map(_words, found.real))]
    rows += [(row.title, row.method, *map(_words, row.answers)) for row in found.rows]
    return rows


def text(found: Told) -> str:
    """Return the touches, the table, the skipped devices and the findings for a terminal."""
    out = [
        f"touch {k}: {touch.start:.2f} to {touch.end:.2f} s, from frame {touch.frame:g}"
        for k, touch in enumerate(found.touches, 1)
    ]
    out += ["", *aligned(lines(found)), ""]
    return "\n".join([*out, *(f"skipped: {s.title}: {s.why}" for s in found.skipped), *map(str, found.findings), NOTE])


def csv(found: Told) -> str:
    """Return the answers as CSV, a row for each device, method and pair."""
    about = {"scene": found.scene, "finger": found.finger, "generator": f"dermis {version()}", "note": NOTE}
    out = ["# dermis-told-apart 1", *(f"# {k}: {v}".replace("\n", " ") for k, v in about.items())]
    out += [f"# touch {k}: {t.start:.6g} to {t.end:.6g} s" for k, t in enumerate(found.touches, 1)]
    out += [f"# skipped {s.device}: {s.why}".replace("\n", " ") for s in found.skipped]
    out += [f"# {finding}".replace("\n", " ") for finding in found.findings]
    out.append("device,method,first,second,d_any,d_as_real,right")
    for device, method, answers in (("", "", found.real), *((r.device, r.method, r.answers) for r in found.rows)):
        for (i, j), a in zip(found.pairs, answers, strict=True):
            out.append(f"{device},{method},{i + 1},{j + 1},{a.apart:.9g},{a.as_real:.9g},{a.right:.9g}")
    return "\n".join(out) + "\n"


def as_dict(found: Told) -> dict[str, Any]:
    """Return the contents of the panel, as plain JSON values."""
    rows = [("", REAL, "", found.real), *((r.device, r.title, r.method, r.answers) for r in found.rows)]
    return {
        "finger": found.finger,
        "touches": [{"start": t.start, "end": t.end, "frame": t.frame} for t in found.touches],
        "pairs": [[i + 1, j + 1] for i, j in found.pairs],
        "rows": [
            {
                "device": d,
                "title": t,
                "method": m,
                "right": [a.right for a in answers],
                "any": [a.apart for a in answers],
            }
            for d, t, m, answers in rows
        ],
        "skipped": [{"title": s.title, "why": s.why} for s in found.skipped],
        "findings": [f"{f.what}. {f.remedy}".rstrip(". ") for f in found.findings],
    }


def write(found: Told, folder: Path) -> Path:
    """Write the CSV into a folder atomically and return its path.

    Raises:
        DermisError: the folder cannot be written.
    """
    path = Path(folder) / FileNames().take(f"{safe(found.finger) or 'finger'}.told-apart", ".csv")
    write_bytes(path, csv(found).encode())
    return path


def _words(answer: Answer) -> str:
    return f"{100 * answer.right:.0f} % right, d' {answer.apart:.1f}"
