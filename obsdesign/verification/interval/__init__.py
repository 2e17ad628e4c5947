"""Claims and guarantees of interval observers, proved."""
