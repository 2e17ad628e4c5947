"""A sliding window of products and triangular factors: steps of one cost at any length.

A window is a product of elements "measure, then move": (Phi, R, count) with R'R the weighted
information of its measurements about the state where it starts. Joined, b after a,

    Phi = Phi_b Phi_a,   R = R factor of [alpha^-count_b R_a; R_b Phi_a].

Nothing is ever taken out of a product (that would need the inverse of a jump): two stacks make a
queue, the older one holding products up to its end, which are popped one after the other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.state_marks import Axes


@dataclass(frozen=True, slots=True)
class Element:
    """move Phi (r, r); factor R (rows, r); count: measurements in it."""

    move: Annotated[Matrix, Axes("r r")]
    factor: Annotated[Matrix, Axes("rows r")]
    count: int = 1

    def then(self, later: Element, alpha: float, mask: Matrix) -> Element:
        """The product of this element and a later one; mask: ones on and above the diagonal."""
        rows = np.concatenate((alpha**-later.count * self.factor, later.factor @ self.move))
        if len(rows) > rows.shape[1]:
            # Householder vectors below the diagonal are masked: numpy's own way takes twice as long
            reflected: Matrix = np.linalg.qr(rows, mode="raw")[0]
            rows = reflected.T[: len(mask)] * mask
        return Element(later.move @ self.move, rows, self.count + later.count)


@dataclass(frozen=True, slots=True)
class SlidingWindow:
    """A queue of elements with their product; every operation returns a new queue.

    front: (product from an element to the end of this stack, the element), the oldest last; back:
    elements that came since, the newest last; recent: their product.
    """

    alpha: float
    mask: Annotated[Matrix, Axes("r r")]
    front: tuple[tuple[Element, Element], ...] = ()
    back: tuple[Element, ...] = ()
    recent: Element | None = None

    @staticmethod
    def from_elements(elements: Iterable[Element], alpha: float) -> SlidingWindow:
        """A queue of these elements, oldest first."""
        listed = list(elements)
        columns = listed[0].factor.shape[1] if listed else 0
        queue = SlidingWindow(alpha, np.triu(np.ones((columns, columns))))
        for element in listed:
            queue = queue.push(element)
        return queue

    def push(self, element: Element) -> SlidingWindow:
        """Append the newest element."""
        joined = element if self.recent is None else self._joined(self.recent, element)
        back = (*self.back, element)
        return SlidingWindow(self.alpha, self.mask, self.front, back, joined)

    def pop(self) -> SlidingWindow:
        """Drop the oldest element; IndexError if there is none."""
        if self.front:
            return SlidingWindow(self.alpha, self.mask, self.front[:-1], self.back, self.recent)
        if not self.back:
            raise IndexError("the window is empty")
        front: list[tuple[Element, Element]] = []
        for element in reversed(self.back):
            product = self._joined(element, front[-1][0]) if front else element
            front.append((product, element))
        return SlidingWindow(self.alpha, self.mask, tuple(front[:-1]))

    @property
    def product(self) -> Element | None:
        """All elements joined; None for an empty queue."""
        if not self.front or self.recent is None:
            return self.front[-1][0] if self.front else self.recent
        return self._joined(self.front[-1][0], self.recent)

    @property
    def is_empty(self) -> bool:
        """Whether there is no element."""
        return not self.front and self.recent is None

    def _joined(self, older: Element, newer: Element) -> Element:
        return older.then(newer, self.alpha, self.mask)

    def elements(self) -> list[Element]:
        """All elements, oldest first."""
        return [element for _, element in reversed(self.front)] + list(self.back)

    def stretched(self, move: Matrix) -> SlidingWindow:
        """Append a move to the newest element: an impulse without measurement lies in it."""
        elements = self.elements()
        if not elements:
            return self
        last = elements[-1]
        longer = Element(move @ last.move, last.factor, last.count)
        return SlidingWindow.from_elements([*elements[:-1], longer], self.alpha)
