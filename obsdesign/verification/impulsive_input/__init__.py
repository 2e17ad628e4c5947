"""Claims and guarantees about impulsive inputs, proved."""
