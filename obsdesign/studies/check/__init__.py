"""The observer kinds that a plant admits, and what to try next."""
