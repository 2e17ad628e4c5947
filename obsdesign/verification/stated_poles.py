"""The claim that the error has the poles that a problem states."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.balls import Exact, exact
from lmi.verdict import Verdict, proved, refuted
from obsdesign.analysis.stated_poles import complex_text, gap, with_conjugates
from obsdesign.document import Claim
from obsdesign.problem.options import Pole
from obsdesign.verification.choices import mark_witness

ID = "poles"


def poles_claim(
    F: Exact,
    poles: Sequence[Pole],
    *,
    name: str = "A - L C",
    changes: Sequence[Exact] = (),
    rate: float | None = 0.0,
    has_others: bool = False,
) -> Claim:
    """Claim that the stated poles are eigenvalues of F (n, n), up to the rounding of gains.

    name: that of F; changes: what the rounding of single gains adds to F; rate: at which every pole
    must decay, None where none must: a pole that does not refutes every gain; has_others: F may
    have more eigenvalues, which no gain moves.
    """
    values = with_conjugates(poles)
    listed = ", ".join(complex_text(v) for v in values.tolist() if v.imag >= 0)
    if len(values) == len(F) or (has_others and len(values) < len(F)):
        verdict, sense = _decided(F, poles, name, changes)
    else:
        reason = f"{len(values)} poles are stated; {name} has {len(F)}"
        verdict, sense = refuted({"poles": len(values), "reason": reason}), ""
    slow = [v for v in values.tolist() if rate is not None and v.real >= -rate]
    if slow:
        verdict = refuted(_slow_pole(max(slow, key=lambda v: float(v.real)), rate or 0.0))
    claim = Claim.from_verdict(
        ID,
        f"the stated poles {listed} are those of {name}{sense}",
        "exact characteristic polynomial",
        verdict,
    )
    return mark_witness(claim) if slow else claim


def rounding_of_gain(L: Array, C: Array) -> list[Exact]:
    """What one unit in the last place of each entry of L (n, p) adds to A - L C."""
    changes = []
    for i, j in np.argwhere(L != 0):
        change = exact(np.zeros((len(L), C.shape[1])))
        change[i] = -exact(np.spacing(abs(L[i, j]))) * exact(C[j])
        changes.append(change)
    return changes


def rounding_of_entries(F: Array) -> list[Exact]:
    """What one unit in the last place of each entry of F (n, n) adds to it."""
    return [
        change
        for k in range(len(F))
        for change in rounding_of_gain(np.where(np.arange(len(F)) == k, F, 0.0), np.eye(len(F)))
    ]


def _decided(
    F: Exact, poles: Sequence[Pole], name: str, changes: Sequence[Exact]
) -> tuple[Verdict, str]:
    """Verdict, and in which sense the poles are those of F."""
    result = gap(F, poles)
    if not result.is_rounding:
        result = gap(F, poles, changes)
    if result.is_rounding:
        size = _up(result.relative)
        sense = (
            f", every coefficient of its polynomial to {size} of that of the product of s + |pole|"
        )
        return proved(relative=result.relative), sense
    reason = (
        f"{name} does not have the stated poles: the coefficient of s^{result.degree} of its "
        f"polynomial is off by {result.relative:.3g} of that of the product of s + |pole|"
    )
    witness = {"degree": result.degree, "relative": result.relative, "reason": reason}
    return refuted(witness), ""


def _slow_pole(pole: complex, rate: float) -> dict[str, object]:
    """Witness against every gain with this pole."""
    how = f"like e^(-{rate!r} t) or faster" if rate else ""
    reason = f"the stated pole {complex_text(pole)} does not decay {how}".rstrip()
    return {"pole": {"real": pole.real, "imag": abs(pole.imag)}, "reason": reason}


def _up(value: float) -> str:
    """Two digits, not below the value; rounding alone is 1e-12."""
    if value <= 1e-12:
        return "1e-12"
    power = math.floor(math.log10(value)) - 1
    return f"{math.ceil(value / 10.0**power) * 10.0**power:.2g}"
