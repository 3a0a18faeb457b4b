"""Checks of the day of a measurement and of its valid number of days."""

from __future__ import annotations

from datetime import date

from ..errors import DermisError

MOST_DAYS = 3650


def check_day(measured_on: object, valid_days: object, where: str) -> None:
    """Raise an error for an invalid day or number of days.

    Args:
        measured_on: day as in '2026-11-27'; '' if it is not known.
        valid_days: number of days, 0 to `MOST_DAYS`.
        where: name of the file, for the error.

    Raises:
        DermisError: the day or the number of days is invalid.
    """
    if type(valid_days) is not int or not 0 <= valid_days <= MOST_DAYS:
        raise DermisError("'valid_days' is no number of days", where=where, value=valid_days, limit=f"0 to {MOST_DAYS}")
    _day(measured_on, where)


def age_of(measured_on: str, today: date) -> int | None:
    """Return the days since a measurement; None if its day is not known."""
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
