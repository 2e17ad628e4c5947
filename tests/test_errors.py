"""Refusals name what they are about; faults of the program stay faults."""

from __future__ import annotations

import pytest

from obsdesign.errors import DoesNotApply, InputError, naming


@pytest.mark.parametrize("kind", [InputError, DoesNotApply])
def test_a_refusal_begins_with_its_file(kind: type[InputError]) -> None:
    with pytest.raises(InputError, match=r"^p\.toml: flow\.A is missing\.$"), naming("p.toml"):
        raise kind("flow.A is missing.")


def test_a_fault_is_no_refusal() -> None:
    """The twin: a ValueError of a library is not the user's mistake, unless it is said to be."""
    with pytest.raises(ValueError, match=r"^shapes") as fault, naming("p.toml"):
        raise ValueError("shapes differ")
    assert type(fault.value) is ValueError
    with pytest.raises(InputError, match=r"^gains: shapes differ$"), naming("gains", ValueError):
        raise ValueError("shapes differ")
