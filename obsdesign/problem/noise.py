"""Entries of [output] about the noise: numbers or pairs [lower, upper], one per output."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix, Value
from obsdesign.entries import is_number, matrix, real, require_shape, shown, size_text, vector
from obsdesign.errors import InputError


def noise_numbers(values: Value, C: Matrix, entry: str) -> Matrix:
    """Numbers >= 0, (p,), from a list with one per row of C (p, n) or from one for all.

    entry: its name, as output.noise_std, for InputError.
    """
    noise = vector([real(values, entry)] * len(C) if np.ndim(values) == 0 else values, entry)
    require_shape(
        noise, entry, (len(C),), f"one per row of {entry.rpartition('.')[0]}.C ({size_text(C)})"
    )
    for i in np.flatnonzero(noise < 0):
        raise InputError(f"{entry} must be >= 0; got {noise[i]:g} for output {i + 1}.")
    return noise


def noise_pairs(values: Value, C: Matrix, output: str) -> Matrix | None:
    """Pairs [lower, upper], (p, 2), where at least one bound of the noise is a pair; else None.

    output: what messages call the block. InputError for pairs that are none, or swapped ends.
    """
    entry = f"{output}.noise_bound"
    listed = values if isinstance(values, list | tuple | np.ndarray) else []
    if not any(isinstance(item, list | tuple | np.ndarray) for item in listed):
        if len(listed) == 2 and all(map(is_number, listed)) and listed[0] < 0 <= listed[1]:
            raise InputError(
                f"{entry} must hold numbers >= 0 or pairs [lower, upper]; got {shown(values)}. "
                "Is it one pair? That is written [[lower, upper]]."
            )
        return None
    for item in listed:
        if not is_number(item) and np.shape(item) != (2,):
            raise InputError(
                f"{entry} must hold numbers or pairs [lower, upper]; got {shown(item)}."
            )
    pairs = matrix([[-item, item] if is_number(item) else item for item in listed], entry)
    require_shape(pairs, entry, (len(C), 2), f"one pair per row of {output}.C ({size_text(C)})")
    for i in np.flatnonzero(pairs[:, 0] > pairs[:, 1]):
        raise InputError(
            f"{entry}: lower must not exceed upper; got lower {pairs[i, 0]:g} > upper "
            f"{pairs[i, 1]:g} for output {i + 1}. Are they swapped?"
        )
    return pairs
