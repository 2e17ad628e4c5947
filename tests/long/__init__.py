"""Long random checks, run by hand: python -m tests.long.NAME."""
