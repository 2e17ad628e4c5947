"""Claims about given gains, proved without any optimisation solver; one file per kind."""
