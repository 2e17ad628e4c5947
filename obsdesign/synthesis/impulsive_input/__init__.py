"""Candidates for impulsive inputs: exponents, operator, window."""
