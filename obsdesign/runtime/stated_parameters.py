"""The nominal plant and the effects of parameters that the problem of a design states."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, NewEntries, Value
from obsdesign.document import jsonable, same
from obsdesign.equations.noise_bounds import noise_box
from obsdesign.equations.parameters import fractions_of, rounded

# matrices that parameters add to, and where the problem states them
_PLACES = {"A": "flow", "B": "flow", "G": "jump", "E": "jump", "C": "output"}
_RADII = {"A": ("flow", "A_radius"), "G": ("jump", "G_radius"), "C": ("output", "C_radius")}

# gains that effects widen: those of the problem are inside
WIDENED = ("noise_bound", "noise_centre", "disturbance_matrix", "jump_disturbance_matrix")


def has_parameters(problem: Entries) -> bool:
    """Has the problem of a design parameters, or radii of entries?"""
    tables = [problem.get(block) for block, _ in _RADII.values()]
    pairs = zip(tables, _RADII.values(), strict=True)
    has_radii = any(isinstance(table, dict) and key in table for table, (_, key) in pairs)
    return has_radii or bool(problem.get("parameter"))


def nominal_blocks(problem: Entries) -> Entries:
    """The blocks of a problem with nominal matrices; ValueError where parameters are none."""
    return _read(problem)[0]


def widened_blocks(problem: Entries, gains: Entries) -> Entries:
    """The same for gains whose bounds include the effects of parameters.

    ValueError also where the gains hold other effects or a smaller noise bound.
    """
    blocks, effects = _read(problem)
    if not same(jsonable(gains.get("effects")), jsonable(effects)):
        raise ValueError("effects differ from problem.parameter; `obsdesign verify` refutes them")
    stated = noise_box(blocks["output"]["noise_bound"])[1]
    kept = np.asarray(gains.get("noise_bound"), np.float64)
    if kept.shape != stated.shape or not (kept >= stated).all():
        raise ValueError("noise_bound is below that of the problem; `obsdesign verify` refutes it")
    return blocks


def _read(problem: Entries) -> tuple[NewEntries, list[NewEntries]]:
    """(blocks, effects); ValueError where parameters are none."""
    try:
        return _nominal(problem)
    except (TypeError, KeyError, AttributeError, OverflowError) as error:
        raise ValueError(f"problem.parameter cannot be read: {error}") from None


def _nominal(problem: Entries) -> tuple[NewEntries, list[NewEntries]]:
    blocks: NewEntries = {
        name: dict(table) if isinstance(table, dict) else table for name, table in problem.items()
    }
    matrices: dict[str, Array] = {
        key: fractions_of(np.array(blocks[block][key], np.float64))
        for key, block in _PLACES.items()
        if block in blocks and key in blocks[block]
    }
    effects = []
    for parameter in [*problem.get("parameter", ()), *_of_radii(blocks)]:
        low, high = (Fraction(float(end)) for end in parameter["range"])
        effect: NewEntries = {"name": parameter["name"]}
        for key in _PLACES:
            if key in parameter:
                unit = fractions_of(np.array(parameter[key], np.float64))
                matrices[key] = matrices[key] + (low + high) / 2 * unit
                effect[key] = rounded((high - low) / 2 * unit)
        effects.append(effect)
    for key, values in matrices.items():
        blocks[_PLACES[key]][key] = rounded(values)
    return blocks, effects


def _of_radii(blocks: Entries) -> list[Value]:
    """A parameter for each entry of a radius other than 0, in their order."""
    listed = []
    for key, (block, name) in _RADII.items():
        table = blocks.get(block)
        radius = np.array(table[name] if isinstance(table, dict) and name in table else [[]])
        for i, j in np.argwhere(radius).tolist():
            unit = np.zeros(radius.shape)
            unit[i, j] = 1.0
            half = float(radius[i, j])
            named = f"{key.lower()}_radius_{i + 1}_{j + 1}"
            listed.append({"name": named, "range": [-half, half], key: unit})
    return listed
