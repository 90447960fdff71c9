"""GPS time: seconds since 6 January 1980, 00:00 UTC, without leap seconds.

    t = UTC - 6 January 1980 + 18 s          week = floor(t / 604800)

18 leap seconds have held since 1 January 2017; times before that are up to 18 s off.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

WEEK_S = 604_800
_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)
_LEAP_S = 18
# Of a run without a time: the same as that of the VectorNav stream of an External AHRS.
DEFAULT_UTC = datetime(2026, 1, 1, 12, tzinfo=UTC)


def gps_seconds(utc: datetime) -> float:
    """Return GPS time [s] of a time with a time zone."""
    return (utc - _EPOCH).total_seconds() + _LEAP_S


def utc_of(t_s: float) -> datetime:
    """Return the time of GPS time `t_s` [s], to the second."""
    return _EPOCH + timedelta(seconds=round(t_s) - _LEAP_S)


def week_start_s(t_s: float) -> float:
    """Return the GPS time [s] at which the week of `t_s` began."""
    return float(int(t_s) // WEEK_S * WEEK_S)


def full_week(week: int, t_s: float) -> int:
    """Return the week near GPS time `t_s` that a week number of 10 bits means, or `week` if it has more."""
    if week >= 1024:
        return week
    now = int(t_s) // WEEK_S
    return week + 1024 * ((now - week + 512) // 1024)
