"""Claims and guarantees of the point observer, proved."""
