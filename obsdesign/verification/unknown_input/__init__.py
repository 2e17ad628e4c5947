"""Claims and guarantees of the unknown-input observer, proved."""
