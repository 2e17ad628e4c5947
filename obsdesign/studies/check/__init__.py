"""Which observer kinds a plant admits, and what to try next."""
