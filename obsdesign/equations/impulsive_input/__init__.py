"""Formulas for impulses of unknown time and weight (Mattsson, Medvedev)."""
