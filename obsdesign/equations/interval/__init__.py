"""Formulas of interval observers (Degue, Efimov, Richard)."""
