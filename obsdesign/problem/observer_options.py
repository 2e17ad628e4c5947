"""What is asked of an observer: gains that are kept and options, checked against kind and plant.

The schema has seen to names, types and words; here numbers are finite, matrices have the sizes the
plant gives them, and entries agree with each other.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from obsdesign.entries import Array, in_range, matrix, shown
from obsdesign.errors import InputError
from obsdesign.problem.kinds import GAINS, INVERTIBLE, KINDS, OPTIONS, WHOLE
from obsdesign.problem.plant import Plant


def gains(given: Mapping[str, Any], kind: str | None, plant: Plant) -> dict[str, Array]:
    """Finite, read-only gain matrices of the sizes that the kind gives them (kind None: any).

    InputError also for coordinates that are singular or do not hold D where they must.
    """
    found = {}
    for name, values in given.items():
        entry = f"observer.gains.{name}"
        found[name] = matrix(values, entry) if kind is None else _sized(values, entry, kind, plant)
        n = len(found[name])
        if kind is not None and name in INVERTIBLE and np.linalg.matrix_rank(found[name]) < n:
            raise InputError(
                f"{entry} must be invertible; its rank is {np.linalg.matrix_rank(found[name])}, "
                f"of {n}."
            )
    if kind == "unknown_input":
        _check_coordinates(found, plant)
    return found


def _sized(values: Any, entry: str, kind: str, plant: Plant) -> Array:
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
    found = matrix(np.zeros(shape) if none else values, entry, empty=0 in shape)
    if found.shape != shape:
        hint = " Is it transposed?" if found.shape == shape[::-1] else ""
        where = f"{letters[0]} x {letters[1]}, n states, p outputs"
        where += ", q unknown inputs" if "q" in letters[1] else ""
        raise InputError(
            f"{entry} must be {shape[0]}x{shape[1]} ({where}); "
            f"got {found.shape[0]}x{found.shape[1]}.{hint}"
        )
    return found


def _check_coordinates(found: Mapping[str, Array], plant: Plant) -> None:
    if ("L" in found) != ("T1" in found):
        absent = "T1" if "L" in found else "L"
        raise InputError(
            f"observer.gains.{absent} is required: L and T1 are given together; it is missing."
        )
    D = plant.flow.D
    if "T1" in found and D is not None and not np.array_equal(found["T1"][:, -D.shape[1] :], D):
        raise InputError(
            f"observer.gains.T1 must end with the columns of flow.D, {shown(D)}: T1 = [Ta, D]; "
            f"got {shown(found['T1'])}."
        )


def options(given: Mapping[str, Any], kind: str | None, plant: Plant) -> dict[str, Any]:
    """Options with finite numbers, lists as tuples; InputError for entries that do not agree."""
    found = {}
    for name, value in given.items():
        whole = (kind, name) in WHOLE
        found[name] = _numbers(value, f"observer.{name}", whole)
    for name, check in _CHECKS.items():
        if kind is not None and name in found:
            check(found, kind, plant)
    return found


def _numbers(value: Any, entry: str, whole: bool) -> Any:
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


def _check_weights(found: Mapping[str, Any], kind: str, plant: Plant) -> None:
    for name, size, what in (("state", plant.n, "state"), ("output", plant.p, "output")):
        given = len(found["weights"].get(name, range(size)))
        if given != size:
            raise InputError(
                f"observer.weights.{name} must have {size} {'entry' if size == 1 else 'entries'}, "
                f"one per {what}; got {given}."
            )


def _check_schedule(found: Mapping[str, Any], kind: str, plant: Plant) -> None:
    cells = found["schedule"]
    if isinstance(cells, tuple) and any(a >= b for a, b in itertools.pairwise(cells)):
        raise InputError(f"observer.schedule must be increasing; got {shown(list(cells))}.")


def _check_exponents(found: Mapping[str, Any], kind: str, plant: Plant) -> None:
    exponents = found["exponents"]
    for i, exponent in enumerate(exponents):
        if exponent in exponents[:i]:
            raise InputError(f"observer.exponents must differ; {exponent!r} stands twice.")


def _check_noise_target(found: Mapping[str, Any], kind: str, plant: Plant) -> None:
    given = len(found["noise_target"])
    if given != plant.n:
        raise InputError(
            f"observer.noise_target must have {plant.n} {'entry' if plant.n == 1 else 'entries'}, "
            f"one per state; got {given}."
        )


def _check_initial_std(found: Mapping[str, Any], kind: str, plant: Plant) -> None:
    given = len(found["initial_std"])
    if given != plant.n:
        raise InputError(
            f"observer.initial_std must have {plant.n} {'entry' if plant.n == 1 else 'entries'}, "
            f"one per state; got {given}."
        )


def _check_width_weights(found: Mapping[str, Any], kind: str, plant: Plant) -> None:
    given = found["width_weights"]
    if len(given) != plant.n:
        raise InputError(
            f"observer.width_weights must have {plant.n} "
            f"{'entry' if plant.n == 1 else 'entries'}, one per state; got {len(given)}."
        )
    if not any(given):
        raise InputError("observer.width_weights must not all be zero.")


def _check_margin(found: Mapping[str, Any], kind: str, plant: Plant) -> None:
    margin, window = found["margin"], found.get("window", math.inf)
    if margin >= window:
        raise InputError(
            f"observer.margin must be less than observer.window = {window!r}; got {margin!r}."
        )


_CHECKS: Mapping[str, Callable[[Mapping[str, Any], str, Plant], None]] = MappingProxyType(
    {
        "weights": _check_weights,
        "schedule": _check_schedule,
        "exponents": _check_exponents,
        "margin": _check_margin,
        "noise_target": _check_noise_target,
        "initial_std": _check_initial_std,
        "width_weights": _check_width_weights,
    }
)


def for_kind(observer: Mapping[str, Any], kind: str) -> tuple[dict[str, Any], list[str]]:
    """[observer] rewritten for a kind, and the entries that were dropped, by name.

    Entries that the written kind knows are its own and mean nothing to another; entries that it
    does not know stay if `kind` does. Names that no kind knows stay, to be complained of.
    """
    if kind not in KINDS:
        raise InputError(f"kind must be one of {', '.join(KINDS)}; got {kind!r}.")
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
        kept["gains"] = {name: value for name, value in given.items() if keeps(name, GAINS)}
        dropped = [f"gains.{name}" for name in given if name not in kept["gains"]]
    rest = {name: value for name, value in observer.items() if name not in ("kind", "gains")}
    kept |= {name: value for name, value in rest.items() if keeps(name, OPTIONS)}
    return kept, dropped + [name for name in rest if name not in kept]
