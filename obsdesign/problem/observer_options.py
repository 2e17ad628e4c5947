"""The [observer] block: gains that are kept and options, checked against kind and plant.

The schema has checked names, types and words; here numbers are finite, matrices have the sizes the
plant gives them, and entries agree with each other.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from types import MappingProxyType

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries, Value
from obsdesign.entries import in_range, matrix, shown
from obsdesign.errors import InputError
from obsdesign.kinds import GAINS, WITH_NAMED_GAINS, kind_named
from obsdesign.problem import named_gains
from obsdesign.problem.option_table import OPTIONS, OPTIONS_OF, is_whole
from obsdesign.problem.options_base import Options, UnassignedOptions
from obsdesign.problem.plant import Plant

# changes of coordinates: their inverse is needed
INVERTIBLE = ("S", "S2", "T1")


def gains(given: Entries, kind: str | None, plant: Plant) -> dict[str, Matrix]:
    """Finite, read-only gain matrices of the sizes that the kind gives them (kind None: any).

    InputError also for coordinates that are singular or do not hold D where they must.
    """
    matrices = {}
    for name, values in named_gains.flattened(given, kind, plant).items():
        if "." in name:
            matrices[name] = named_gains.sized(values, name, plant)
            continue
        entry = f"observer.gains.{name}"
        matrices[name] = (
            matrix(values, entry) if kind is None else _sized(values, entry, kind, plant)
        )
        n = len(matrices[name])
        if kind is not None and name in INVERTIBLE and np.linalg.matrix_rank(matrices[name]) < n:
            raise InputError(
                f"{entry} must be invertible; in floating point its rank is "
                f"{np.linalg.matrix_rank(matrices[name])}, of {n}."
            )
    if kind == "unknown_input":
        _check_coordinates(matrices, plant)
    return matrices


def _sized(values: Value, entry: str, kind: str, plant: Plant) -> Matrix:
    letters = GAINS[kind][entry.rpartition(".")[2]]
    q = 0 if plant.flow.D is None else plant.flow.D.shape[1]
    if kind == "unknown_input" and not 0 < q <= plant.p:
        raise InputError(
            f"{entry} requires flow.D with at most as many columns as output.C has rows "
            f"({plant.p}); {f'D has {q}' if q else 'D is missing'}."
        )
    sizes = {"n": plant.n, "p": plant.p, "n-q": plant.n - q, "p-q": plant.p - q}
    shape = tuple(sizes[letter] for letter in letters)
    none = shape[0] == 0 and isinstance(values, list) and not values  # [] has lost its columns
    result = matrix(np.zeros(shape) if none else values, entry, empty=0 in shape)
    if result.shape != shape:
        hint = " Is it transposed?" if result.shape == shape[::-1] else ""
        where = f"{letters[0]} x {letters[1]}, n states, p outputs"
        where += ", q unknown inputs" if "q" in letters[1] else ""
        raise InputError(
            f"{entry} must be {shape[0]}x{shape[1]} ({where}); "
            f"got {result.shape[0]}x{result.shape[1]}.{hint}"
        )
    return result


def _check_coordinates(matrices: Mapping[str, Matrix], plant: Plant) -> None:
    if ("L" in matrices) != ("T1" in matrices):
        absent = "T1" if "L" in matrices else "L"
        raise InputError(
            f"observer.gains.{absent} is required: L and T1 are given together; it is missing."
        )
    T1, D = matrices.get("T1"), plant.flow.D
    if T1 is not None and D is not None and not np.array_equal(T1[:, -D.shape[1] :], D):
        raise InputError(
            f"observer.gains.T1 must end with the columns of flow.D, {shown(D)}: T1 = [Ta, D]; "
            f"got {shown(T1)}."
        )


def options(given: Entries, kind: str | None, plant: Plant) -> Options:
    """Options with finite numbers, lists as tuples; InputError for entries that do not agree."""
    entries = {
        name: _numbers(value, f"observer.{name}", is_whole(kind, name))
        for name, value in given.items()
    }
    result = (UnassignedOptions if kind is None else OPTIONS_OF[kind]).from_entries(entries)
    result.check(plant)
    return result


def _numbers(value: Value, entry: str, whole: bool) -> Value:
    """Finite binary64 numbers (integers where `whole`), read-only containers."""
    if isinstance(value, list):
        return tuple(
            _numbers(item, f"{entry}, entry {i + 1}", False) for i, item in enumerate(value)
        )
    if isinstance(value, Mapping):
        items = {name: _numbers(item, f"{entry}.{name}", False) for name, item in value.items()}
        return MappingProxyType(items)
    if isinstance(value, bool | str):
        return value
    try:
        number = float(value) + 0.0
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{entry} must be a finite number; got {shown(value)}.")
    in_range(number, entry)
    return int(number) if whole and number == int(number) else number


def for_kind(observer: Entries, kind: str) -> tuple[NewEntries, list[str]]:
    """[observer] rewritten for a kind, and the entries that were dropped, by name.

    Entries that the written kind knows are its own and mean nothing to another; entries that it
    does not know stay if `kind` does. Names that no kind knows stay, to be complained of.
    """
    kind_named(kind)
    written = observer.get("kind")
    own = written if isinstance(written, str) and written != kind else None

    def keeps(name: str, table: Mapping[str, Collection[str]]) -> bool:
        if not any(name in names for names in table.values()):
            return True
        return name in table[kind] and name not in table.get(own or "", ())

    given = observer.get("gains", {})
    kept = {"kind": kind, "gains": given}
    dropped = []
    if isinstance(given, Mapping):
        kept["gains"] = {
            name: value
            for name, value in given.items()
            if keeps(name, GAINS) and (not isinstance(value, Mapping) or kind in WITH_NAMED_GAINS)
        }
        dropped = [f"gains.{name}" for name in given if name not in kept["gains"]]
    stated = {name: value for name, value in observer.items() if name not in ("kind", "gains")}
    kept |= {name: value for name, value in stated.items() if keeps(name, OPTIONS)}
    return kept, dropped + [name for name in stated if name not in kept]
