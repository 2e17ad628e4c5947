"""The result of a search, typed; `Outcome.result` holds it as the JSON answer states it."""

from __future__ import annotations

from dataclasses import dataclass, field

from lmi.arithmetic.arrays import Entries, NewEntries
from lmi.time_budget import ended_part


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """A bracket: the end that is proved, and the nearest one that is not.

    accuracy: relative width that is required; None where no bracket was searched for. kept: the
    other end of the range; common_P: the end that one P proves, where windows of dwell times were
    tried beyond it; open: relative width between proved and not proved; islands: ranges of constant
    dwell times beyond the bracket that contract as well; reason, witness: why the far end is not
    proved; these_gains: the witness where it concerns only gains that were searched for; form,
    gains: those of the best candidate; ended: the budget that ended the search.
    """

    proved: float | None = None
    not_proved: float | None = None
    not_proved_verdict: str | None = None
    accuracy: float | None = None
    kept: float | None = None
    common_P: float | None = None
    open: float | None = None
    islands: tuple[tuple[float, float], ...] = ()
    reason: str | None = None
    witness: Entries | None = None
    these_gains: Entries = field(default_factory=dict)
    form: str = ""
    gains: Entries = field(default_factory=dict)
    ended: Entries = field(default_factory=dict)

    def to_dict(self) -> NewEntries:
        """Entries of the answer of `search --json`."""
        body: NewEntries = {
            "proved": self.proved,
            "not_proved": self.not_proved,
            "not_proved_verdict": self.not_proved_verdict,
        }
        if self.accuracy is None:
            return body | {"form": self.form} | dict(self.ended)
        body |= {
            "accuracy": self.accuracy,
            "kept": self.kept,
            "common_P": self.common_P,
            "open": self.open,
            "islands": [list(island) for island in self.islands],
            "reason": self.reason,
            "witness": self.witness,
            **({"these_gains": dict(self.these_gains)} if self.these_gains else {}),
            "form": self.form,
            "gains": dict(self.gains),
        }
        return body | dict(self.ended)

    @staticmethod
    def from_dict(body: Entries) -> SearchResult:
        """The result of any search; entries that its kind does not state keep their defaults."""
        return SearchResult(
            proved=body["proved"],
            not_proved=body["not_proved"],
            not_proved_verdict=body["not_proved_verdict"],
            accuracy=body.get("accuracy"),
            kept=body.get("kept"),
            common_P=body.get("common_P"),
            open=body.get("open"),
            islands=tuple((low, high) for low, high in body.get("islands", ())),
            reason=body.get("reason"),
            witness=body.get("witness"),
            these_gains=body.get("these_gains", {}),
            form=body.get("form", ""),
            gains=body.get("gains", {}),
            ended=ended_part(body),
        )
