"""Formulas of the impulsive observer (Medina, Lawrence)."""
