"""Find, prove and refute in turns: stability over a range, and brackets of dwell times."""
