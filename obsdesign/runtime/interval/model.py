"""The plant of an interval observer in the observer's coordinates, enclosed.

x = S z: every matrix is known up to the error that S^-1 and the products leave. Without S nothing
is changed and nothing is lost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import overload

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, inverse, raised, stack
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.boxes import midpoint

exactly = Enclosure.exactly


@dataclass(frozen=True)
class Model:
    """Matrices in z. inputs: [B, middle of b], (n, m + 1).

    jump_inputs: [E, middle of c] as they enter x, n rows; b_rad (n,): radius of b. c is
    c_columns @ w as it enters x and |w| <= c_rad; without columns c_rad (n,) is that of c. V,
    y_mid: radius and middle of the noise; width: upper bound of W = D0 + D1; S, S_inverse: None
    where z is x; relative_error: of stored numbers of the plant.
    """

    A: Enclosure
    C: Enclosure
    L: Enclosure
    inputs: Enclosure
    jump_inputs: Enclosure
    b_rad: Matrix
    c_columns: Enclosure | None
    c_rad: Matrix
    V: Matrix
    y_mid: Matrix
    width: Matrix
    S: Enclosure | None
    S_inverse: Enclosure | None
    relative_error: float = 0.0

    def inward(self, X: Enclosure) -> Enclosure:
        """S^-1 X."""
        return X if self.S_inverse is None else self.S_inverse @ X

    def similar(self, X: Enclosure) -> Enclosure:
        """S^-1 X S."""
        return X if self.S is None else self.inward(X) @ self.S

    def from_plant(self, centre: Matrix, radius: Matrix) -> Matrix:
        """[r; m], (2n,), of a box in z that contains a box of x."""
        if self.S is None or self.S_inverse is None:
            return np.concatenate([radius, centre])
        z = self.S_inverse.mid @ centre
        # z_true - z = S^-1 (x - S z), and x - S z = (x - centre) + (centre - S z)
        off = (exactly(centre) - self.S @ exactly(z)).magnitude
        return np.concatenate([self.spread(raised(radius + off, 1)), z])

    def less_middle(self, known: Enclosure, *gains: Enclosure | None) -> Enclosure:
        """The columns for known inputs, the last for 1, where `gains` act on y - y_mid."""
        if not self.y_mid.any():
            return known
        column = Enclosure(known.mid[:, -1:], known.rad[:, -1:])
        for K in gains:
            column = column if K is None else column - K @ exactly(self.y_mid[:, None])
        ends = ((known.mid, column.mid), (known.rad, column.rad))
        return Enclosure(*(np.hstack([whole[:, :-1], last]) for whole, last in ends))

    def spread(self, radius: Matrix, columns: Enclosure | None = None) -> Matrix:
        """Radius in z of columns @ w, |w| <= radius; without columns of a box of x."""
        if columns is None and self.S_inverse is None:
            return radius
        X = self.S_inverse if columns is None else self.inward(columns)
        assert X is not None
        return raised(size(X) @ radius, 2 * len(radius))


def observer_model(gains: IntervalGains, relative_error: float = 0.0) -> Model:
    """The model of a design; ValueError if S cannot be inverted with certainty.

    relative_error: of the entries of A, B, G, E and C as they are stored.
    """
    S = None if gains.S is None else exactly(gains.S)
    S_inverse = None if gains.S is None else inverse(gains.S)
    A, C = (rounded(X, relative_error) for X in (gains.A, gains.C))
    L = exactly(gains.L)
    b_columns, c_columns = shapes(gains)
    b_mid, b_rad = midpoint(*gains.declared_disturbance[1:])
    c_mid = c_rad = np.zeros(gains.n)
    if gains.G is not None:
        c_mid, c_rad = midpoint(*gains.jump_disturbance[1:])
    y_mid = np.zeros(gains.p) if gains.noise_centre is None else gains.noise_centre
    plant = Model(
        A=A, C=C, L=L, inputs=_known(rounded(gains.B, relative_error), b_columns, b_mid),
        b_rad=b_rad, jump_inputs=_known(rounded(gains.E, relative_error), c_columns, c_mid),
        c_columns=c_columns, c_rad=c_rad, relative_error=relative_error,
        V=gains.noise_bound, y_mid=y_mid,
        width=A.mid, S=S, S_inverse=S_inverse,
    )  # fmt: skip
    A, L = plant.similar(A), plant.inward(L)
    C = C if S is None else C @ S
    F = A if gains.is_periodic else A - L @ C
    return replace(
        plant, A=A, C=C, L=L, inputs=plant.inward(plant.inputs),
        b_rad=plant.spread(b_rad, b_columns),
        width=completed(F, gains.D0, gains.D1, is_flow=True),
    )  # fmt: skip


def shapes(gains: IntervalGains) -> tuple[Enclosure | None, Enclosure | None]:
    """Columns of b and of c as they enter x, None where the bounds are those of b and c."""
    columns = (gains.disturbance_matrix, gains.jump_disturbance_matrix)
    b, c = (None if X is None else exactly(X) for X in columns)
    return b, c


@overload
def rounded(X: Matrix, relative_error: float) -> Enclosure: ...
@overload
def rounded(X: None, relative_error: float) -> None: ...
def rounded(X: Matrix | None, relative_error: float) -> Enclosure | None:
    """A matrix of the plant from its stored numbers, up to their relative error."""
    return None if X is None else Enclosure(X, relative_error * np.abs(X))


def _known(inputs: Enclosure | None, columns: Enclosure | None, middle: Matrix) -> Enclosure:
    """Columns of known inputs and, the last one, what the middle of a disturbance adds."""
    last = exactly(middle[:, None]) if columns is None else columns @ exactly(middle[:, None])
    return last if inputs is None else stack([[inputs, last]])


def completed(X: Enclosure, plus: Matrix, minus: Matrix, *, is_flow: bool = False) -> Matrix:
    """Upper bound of plus + minus + |plus - minus - X|: `splits.completed_split`, summed.

    Parts of the wrong sign, as in a design whose claim about them is not proved, enter by their
    magnitude: the sum is above |X|, for a flow above Mz(X), whatever the split. is_flow: the
    diagonal of plus may have any sign.
    """
    diagonal = np.eye(len(plus), dtype=bool) & is_flow
    remainder = (exactly(plus) - exactly(minus) - X).magnitude
    # the remainder of numbers that agree is zero, not TINY: zeros of W and N are worth keeping
    remainder = np.where((plus - minus == X.mid) & (X.rad == 0), 0.0, remainder)
    plus, minus = np.where(diagonal, plus, np.abs(plus)), np.abs(minus)
    total = (exactly(plus) + exactly(minus)).upper + remainder
    return np.where((plus == 0) & (minus == 0) & (remainder == 0), 0.0, np.nextafter(total, np.inf))


def size(X: Enclosure) -> Matrix:
    """Upper bound of |X|, zero where X is."""
    return np.where((X.mid == 0) & (X.rad == 0), 0.0, X.magnitude)


def metzler_bound(X: Enclosure) -> Matrix:
    """Upper bound of Mz(X): the diagonal, and absolute values elsewhere."""
    on_diagonal = np.eye(len(X.mid), dtype=bool)
    return np.where(on_diagonal, np.where(X.rad == 0, X.mid, X.upper), size(X))
