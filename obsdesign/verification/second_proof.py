"""A proof that is repeated by an independent method."""

from __future__ import annotations

from collections.abc import Callable, Collection

from lmi.verdict import Verdict, undecided


def confirmed(
    first: Verdict, repeat: Callable[[], Verdict], *, certificate: Collection[str] = ()
) -> Verdict:
    """A proved verdict with the evidence of a second proof, undecided without one.

    certificate: keys of the evidence that both proofs share, and the first one states.
    """
    second = repeat()
    if second.outcome != "proved":
        return undecided(f"the second method does not confirm the proof: {second.reason}")
    own = {key: value for key, value in second.evidence.items() if key not in certificate}
    return Verdict("proved", {**first.evidence, "confirmed_by": own})
