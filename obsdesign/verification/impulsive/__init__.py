"""Claims and guarantees of the impulsive observer, proved."""
