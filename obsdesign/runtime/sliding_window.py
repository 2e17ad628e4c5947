"""A sliding window of products and triangular factors: each step costs the same at any length.

A window is a product of elements "measure, then move": (Phi, R, count) with R'R the weighted
information of its measurements about the state where it starts. Joined, b after a,

    Phi = Phi_b Phi_a,   R = R factor of [alpha^-count_b R_a; R_b Phi_a].

Nothing is ever taken out of a product (that would need the inverse of a jump): two stacks make a
queue, the older one holding products up to its end, which are popped one after the other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Element:
    """move Phi (r, r); factor R (rows, r); count: measurements in it."""

    move: Matrix
    factor: Matrix
    count: int = 1

    def then(self, later: Element, alpha: float, mask: Matrix) -> Element:
        """The product of this element and a later one; mask: ones on and above the diagonal."""
        rows = np.concatenate((alpha**-later.count * self.factor, later.factor @ self.move))
        if len(rows) > rows.shape[1]:
            # Householder vectors below the diagonal are masked: numpy's own way takes twice as long
            reflected: Matrix = np.linalg.qr(rows, mode="raw")[0]
            rows = reflected.T[: len(mask)] * mask
        return Element(later.move @ self.move, rows, self.count + later.count)


# (product from here to the end of the stack, its first element, the rest of the stack)
Front = tuple[Element, Element, "Front | None"]
# newest first
Back = tuple[Element, "Back | None"]


@dataclass(frozen=True, slots=True)
class SlidingWindow:
    """A queue of elements with their product; every operation returns a new queue."""

    alpha: float
    mask: Matrix
    front: Front | None = None
    back: Back | None = None
    recent: Element | None = None

    @staticmethod
    def of(elements: Iterable[Element], alpha: float) -> SlidingWindow:
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
        return SlidingWindow(self.alpha, self.mask, self.front, (element, self.back), joined)

    def pop(self) -> SlidingWindow:
        """Drop the oldest element; IndexError if there is none."""
        if self.front is not None:
            return SlidingWindow(self.alpha, self.mask, self.front[2], self.back, self.recent)
        if self.back is None:
            raise IndexError("the window is empty")
        front: Front | None = None
        node: Back | None = self.back
        while node is not None:
            element, node = node
            product = element if front is None else self._joined(element, front[0])
            front = (product, element, front)
        return SlidingWindow(self.alpha, self.mask, front).pop()

    @property
    def product(self) -> Element | None:
        """All elements joined; None for an empty queue."""
        if self.front is None or self.recent is None:
            return self.recent if self.front is None else self.front[0]
        return self._joined(self.front[0], self.recent)

    @property
    def empty(self) -> bool:
        """Is there no element?"""
        return self.front is None and self.recent is None

    def _joined(self, older: Element, newer: Element) -> Element:
        return older.then(newer, self.alpha, self.mask)

    def elements(self) -> list[Element]:
        """All elements, oldest first."""
        older: list[Element] = []
        place = self.front
        while place is not None:
            older.append(place[1])
            place = place[2]
        newer: list[Element] = []
        node = self.back
        while node is not None:
            newer.append(node[0])
            node = node[1]
        return older + newer[::-1]

    def stretched(self, move: Matrix) -> SlidingWindow:
        """The newest element moves further: an impulse without a measurement lies in it."""
        elements = self.elements()
        if not elements:
            return self
        last = elements[-1]
        longer = Element(move @ last.move, last.factor, last.count)
        return SlidingWindow.of([*elements[:-1], longer], self.alpha)
