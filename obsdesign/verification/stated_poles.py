"""The claim that the error has the poles that a problem states."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.balls import Exact, exact
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.stated_poles import (
    LARGEST_GAP,
    ROUNDING,
    Gap,
    complex_text,
    gap,
    with_conjugates,
)
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
    flow: Exact | None = None,
    rate: float | None = 0.0,
    has_others: bool = False,
) -> Claim:
    """Claim that the stated poles are eigenvalues of F (n, n), up to the rounding of gains.

    name: that of F; changes: what the rounding of single gains adds to F; flow: the plant's, of
    F's size; rate: at which every pole must decay, None where none must: a pole that does not
    refutes every gain; has_others: F may have more eigenvalues, which no gain moves.
    """
    values = with_conjugates(poles)
    listed = ", ".join(complex_text(v) for v in values.tolist() if v.imag >= 0)
    if len(values) == len(F) or (has_others and len(values) < len(F)):
        nearest = gap(F, poles, flow=flow)
        if not nearest.is_rounding:
            nearest = gap(F, poles, changes, flow=flow)
        verdict, sense = _decided(nearest, name, 0 in values)
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


def _decided(nearest: Gap, name: str, has_zero: bool) -> tuple[Verdict, str]:
    """Verdict, and in which sense the poles, one of them at 0 or none, are those of a matrix."""
    product = "the product of s + |pole|"
    if has_zero:
        product += f", s + {nearest.size_of_zero!r} for a pole at 0"
    if nearest.is_rounding and nearest.relative <= LARGEST_GAP:
        size = _up(nearest.relative)
        sense = f", every coefficient of its polynomial to {size} of that of {product}"
        return proved(relative=nearest.relative), sense
    miss = (
        f"the coefficient of s^{nearest.degree} of its polynomial is off by "
        f"{nearest.relative:.3g} of that of {product}"
    )
    if nearest.is_rounding:
        reason = (
            f"{miss}: no more than rounding the gain may do, but more than the {LARGEST_GAP:g} "
            "that counts as placed; is a mode of the plant hidden from the outputs but for "
            "rounding, or are the poles far from those of the plant?"
        )
        return undecided(reason, relative=nearest.relative, degree=nearest.degree), ""
    reason = f"{name} does not have the stated poles: {miss}"
    witness = {"degree": nearest.degree, "relative": nearest.relative, "reason": reason}
    return refuted(witness), ""


def _slow_pole(pole: complex, rate: float) -> dict[str, object]:
    """Witness against every gain with this pole."""
    how = f"like e^(-{rate!r} t) or faster" if rate else ""
    reason = f"the stated pole {complex_text(pole)} does not decay {how}".rstrip()
    return {"pole": {"real": pole.real, "imag": abs(pole.imag)}, "reason": reason}


def _up(value: float) -> str:
    """Two digits, not below the value, which may be rounding alone."""
    if value <= ROUNDING:
        return f"{ROUNDING:g}"
    power = math.floor(math.log10(value)) - 1
    return f"{math.ceil(value / 10.0**power) * 10.0**power:.2g}"
