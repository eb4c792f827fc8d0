"""A time in a feed's text: Unix seconds with any number of decimals, or ISO 8601 (UTC without a zone)."""

import re
from datetime import datetime
from decimal import Decimal, InvalidOperation

from gcs.contract.limits import FIRST_NS, LAST_NS

ISO = re.compile(r"(\d{4}-?\d\d-?\d\d[T ]\d\d:?\d\d:?\d\d)(?:[.,](\d+))?(Z|[+-]\d\d:?\d\d)?", re.ASCII)


def time_ns(text: str) -> int | None:
    """UTC nanoseconds, exact to the last digit; None for anything that is no instant from 2000 to 2099."""
    whole, _, decimals = text.partition(".")
    if (
        whole.isdecimal()
        and whole.isascii()
        and (not decimals or (decimals.isdecimal() and decimals.isascii()))
    ):
        t_ns: int | None = int(whole[:12]) * 10**9 + int((decimals + "000000000")[:9])
    elif iso := ISO.fullmatch(text.strip()):
        t_ns = _iso_ns(*iso.groups())
    else:
        t_ns = _decimal_ns(text)
    return t_ns if t_ns is not None and FIRST_NS <= t_ns < LAST_NS else None


def _iso_ns(instant: str, decimals: str | None, zone: str | None) -> int | None:
    try:
        moment = datetime.fromisoformat(instant + (zone or "Z"))
    except ValueError:
        return None
    return int(moment.timestamp()) * 10**9 + int(((decimals or "") + "000000000")[:9])


def _decimal_ns(text: str) -> int | None:
    try:
        seconds = Decimal(text)
    except InvalidOperation:
        return None
    known = seconds.is_finite() and 0 <= seconds < LAST_NS
    return int(seconds * 10**9) if known else None
