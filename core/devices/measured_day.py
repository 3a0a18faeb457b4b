"""When something of a built device was measured, and for how many days it may be used."""

from __future__ import annotations

from datetime import date

from ..errors import DermisError

MOST_DAYS = 3650


def check_day(measured_on: object, valid_days: object, where: str) -> None:
    """Refuse a day that is none, or a number of days that cannot be.

    Raises:
        DermisError: says which.
    """
    if type(valid_days) is not int or not 0 <= valid_days <= MOST_DAYS:
        raise DermisError("'valid_days' is no number of days", where=where, value=valid_days, limit=f"0 to {MOST_DAYS}")
    _day(measured_on, where)


def age_of(measured_on: str, today: date) -> int | None:
    """Return how many days before today a day was; None where nobody says."""
    day = _day(measured_on, "measured on")
    return None if day is None else (today - day).days


def _day(text: object, where: str) -> date | None:
    if text == "":
        return None
    try:
        if not isinstance(text, str) or len(text) != 10:
            raise ValueError
        return date.fromisoformat(text)
    except ValueError:
        raise DermisError("not a day", where=where, value=str(text)[:40], limit="such as 2026-11-27") from None
