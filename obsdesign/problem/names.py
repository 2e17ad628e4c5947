"""Names of events, sensors, modes and parameters."""

from __future__ import annotations

import re

from obsdesign.column_names import (
    BOUNDED,
    EVENT,
    JUMP,
    MODE,
    RECEIVED,
    SIGNALS,
    STATUS,
    TIME,
    TRUTH,
)
from obsdesign.errors import InputError

_NAME = re.compile(r"[a-z][a-z0-9_]*")
# titles of other columns: time, numbered signals, their bounds, words of the format
RESERVED = re.compile(
    rf"[{''.join((*SIGNALS, *BOUNDED, *TRUTH))}]\d+(_.*)?|"
    + "|".join((TIME, JUMP, EVENT, MODE, STATUS, RECEIVED))
)
NAME_SCHEMA = {"type": "string", "title": "a name: small letters, digits and _"}
MODE_NAMES = {"type": "array", "items": {"type": "string"}, "title": "a list of names of modes"}


def check_name(name: str, block: str) -> None:
    """InputError unless an event, a sensor, a mode or a parameter may be called so."""
    if not _NAME.fullmatch(name):
        raise InputError(
            f"{block}.name must be a small letter, then small letters, digits and _; got {name!r}."
        )
    if RESERVED.fullmatch(name):
        raise InputError(f"{block}.name: {name!r} is kept for other columns of data files.")
