"""Exact, ball and midpoint-radius matrices; exponentials and norms with error bounds."""
