"""NONMEM data sets as data files: doses are events, observations samples, infusions inputs.

Columns are read by their names: ID, TIME, EVID, AMT, RATE, CMT, DV, DVID, MDV, ADDL, II; others are
covariates and ignored. "." and an empty cell are no value. Every refusal names the line. Source:
NONMEM Users Guide VI, chapter V.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from obsdesign.entries import LARGEST, number_from_text, shown
from obsdesign.errors import InputError

_SAMPLE, _DOSE, _OTHER, _RESET, _RESET_AND_DOSE = range(5)
_DATES = ("DATE", "DAT1", "DAT2", "DAT3")
_MODELLED = "rates that a model states (-1, -2) are not converted; write the rate itself"


@dataclass(frozen=True)
class NonmemRow:
    """A line of a data set; dv, cmt and dvid None where there is none."""

    where: str
    subject: str
    t: float
    evid: int
    dv: float | None
    dvid: int | None
    amt: float
    rate: float
    cmt: int | None
    addl: int
    ii: float

    @property
    def is_dose(self) -> bool:
        """Is an amount given?"""
        return self.evid in (_DOSE, _RESET_AND_DOSE)

    @property
    def is_unnamed_sample(self) -> bool:
        """Is it an observation whose compartment alone says of what?"""
        return self.evid == _SAMPLE and self.dvid is None and self.cmt is not None

    @property
    def is_reset(self) -> bool:
        """Does the system begin anew?"""
        return self.evid in (_RESET, _RESET_AND_DOSE)


def nonmem_rows(path: str) -> Iterator[NonmemRow]:
    """The lines of a data set; InputError for one that cannot be read or converted."""
    observed = set[int | None]()
    try:
        with open(path, encoding="utf-8-sig", newline="") as stream:
            lines = (x for x in enumerate(csv.reader(stream), 1) if any(map(str.strip, x[1])))
            titles = [title.strip().upper() for title in next(lines, (1, []))[1]]
            _check_titles(titles, path)
            for number, cells in lines:
                if cells[0].strip().startswith("#"):
                    continue
                where = f"{path} line {number}"
                if len(cells) != len(titles):
                    raise InputError(
                        f"{where}: {len(titles)} values are required, one per column; got "
                        f"{len(cells)}."
                    )
                row = _row(_Cells(dict(zip(titles, map(str.strip, cells), strict=True)), where))
                observed |= {row.cmt} if row.is_unnamed_sample else set()
                if len(observed) > 1:
                    raise InputError(
                        f"{where}: DVID is required where observations are of several "
                        f"compartments; CMT is {row.cmt}, and another one before."
                    )
                yield row
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}.") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError(f"{path}: a text file with commas is required; it is not one.") from None


def _check_titles(titles: list[str], path: str) -> None:
    for title in ("TIME", "DV"):
        if title not in titles:
            listed = ", ".join(titles) or "nothing"
            raise InputError(
                f"{path}: column {title} is required; the header has {listed}. Is it a NONMEM data "
                "set with a header?"
            )
    for title in titles:
        if title and titles.count(title) > 1:
            raise InputError(f"{path}: column {title} stands {titles.count(title)} times.")
    if dates := [title for title in _DATES if title in titles]:
        raise InputError(
            f"{path}: {dates[0]} is not converted; TIME must hold the time since one instant, in "
            "the plant's unit."
        )


@dataclass(frozen=True)
class _Cells:
    """Cells of a line by title."""

    texts: Mapping[str, str]
    where: str

    def number(self, title: str) -> float | None:
        """A number, None where there is none."""
        text = self.texts.get(title, ".")
        if text in ("", "."):
            return None
        try:
            value = number_from_text(text)
        except ValueError:
            value = float("nan")
        if not abs(value) <= LARGEST:
            raise InputError(f"{self.where}: {title} must be a number; got {shown(text)}.")
        return value

    def whole(self, title: str) -> int | None:
        """A whole number >= 0, None where there is none."""
        value = self.number(title)
        if value is None:
            return None
        if value != int(value) or value < 0:
            raise InputError(f"{self.where}: {title} must be a whole number >= 0; got {value:g}.")
        return int(value)


def _row(cells: _Cells) -> NonmemRow:
    t, amt = cells.number("TIME"), cells.number("AMT") or 0.0
    if t is None:
        raise InputError(f"{cells.where}: TIME must be a number; it is empty.")
    evid = cells.whole("EVID")
    if evid is None:
        evid = _DOSE if amt else _SAMPLE
    row = NonmemRow(
        cells.where, cells.texts.get("ID", ""), t, evid,
        None if cells.whole("MDV") else cells.number("DV"), cells.whole("DVID") or None, amt,
        cells.number("RATE") or 0.0, cells.whole("CMT") or None, cells.whole("ADDL") or 0,
        cells.number("II") or 0.0,
    )  # fmt: skip
    if reason := _reason_against(row, cells.whole("SS") or 0):
        raise InputError(f"{cells.where}: {reason}.")
    return row


def _reason_against(row: NonmemRow, steady: int) -> str | None:
    """Why a line cannot be converted, None if it can."""
    if row.evid > _RESET_AND_DOSE:
        return f"EVID must be 0, 1, 2, 3 or 4; got {row.evid}"
    if not row.is_dose:
        given = row.amt or row.rate
        return f"EVID must be 1 or 4 where AMT or RATE is given; got {row.evid}" if given else None
    if steady:
        return "doses at steady state (SS) are not converted; write the doses before it"
    if row.rate < 0:
        return f"RATE must be >= 0; got {row.rate:g}: {_MODELLED}"
    if row.amt < 0 or (row.rate and not row.amt):
        return f"AMT must be {'positive' if row.rate else '>= 0'}; got {row.amt:g}"
    if row.addl and not row.ii > 0:
        return f"II must be positive where ADDL is; got {row.ii:g}"
    return None
