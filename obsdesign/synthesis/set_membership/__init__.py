"""Candidates for the multiplier observer: its window."""
