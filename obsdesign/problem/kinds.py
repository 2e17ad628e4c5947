"""The observer kinds: which gains and options each knows. Literal data."""

from __future__ import annotations

from collections.abc import Mapping

# gain -> (rows, columns) in n states, p outputs, q unknown inputs
GAINS: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "interval": {
        "L": ("n", "p"),
        "M": ("n", "p"),
        "S": ("n", "n"),
        "D0": ("n", "n"),
        "D1": ("n", "n"),
        "Gp": ("n", "n"),
        "Gn": ("n", "n"),
        "S2": ("n", "n"),
        "T": ("n", "n"),
    },
    "luenberger": {"L": ("n", "p"), "M": ("n", "p")},
    "impulsive": {},
    "finite_time": {"L": ("n", "p")},
    "impulsive_input": {"K": ("n", "p")},
    "unknown_input": {"L": ("n-q", "p-q"), "T1": ("n", "n")},
}

OPTIONS: Mapping[str, tuple[str, ...]] = {
    "interval": ("form", "objective", "gain_limit", "memory", "width", "width_weights"),
    "luenberger": ("poles", "decay_rate", "weights", "memory", "schedule"),
    "impulsive": ("window", "alpha", "strategy", "decay_rate", "noise_target"),
    "finite_time": ("window", "method", "objective", "half_sample_correction"),
    "impulsive_input": (
        "window", "exponents", "margin", "ratio", "weighting", "operator", "state_correction",
        "nonnegative", "threshold", "check_exponents", "initial_std",
    ),
    "unknown_input": ("poles", "weights", "differentiator", "lag"),
}  # fmt: skip

KINDS = tuple(GAINS)

# what `search` knows: ends of a range of dwell times, and of finite_time
DWELL_SEARCHES = ("shortest_dwell", "longest_dwell")
PERIOD_SEARCHES = ("longest_period", "shortest_window")
SEARCHES = (*DWELL_SEARCHES, *PERIOD_SEARCHES)

# changes of coordinates: their inverse is needed
INVERTIBLE = ("S", "S2", "T1")

# (kind, option) that count something
WHOLE = (
    ("interval", "memory"),
    ("luenberger", "memory"),
    ("luenberger", "schedule"),
    ("impulsive", "window"),
    ("unknown_input", "lag"),
)


def owners(name: str) -> list[str]:
    """Kinds that know an option."""
    return [kind for kind, options in OPTIONS.items() if name in options]
