"""Formulas of the point observer with jump gains."""
