"""Words of the status of a row, the same for both operators."""

MISSING, OPEN = "missing sample", "unresolved"
