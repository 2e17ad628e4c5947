"""Formulas of the unknown-input observer (Ahn) and its differentiators."""
