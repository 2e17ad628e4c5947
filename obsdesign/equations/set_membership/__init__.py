"""Formulas of the multiplier observer: bounds by weak duality over a window of stages."""
