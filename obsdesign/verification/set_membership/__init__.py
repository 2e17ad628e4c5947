"""Claims and guarantees of the multiplier observer, proved."""
