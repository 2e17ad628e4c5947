"""Bounds of positive systems for all times, peak gains, and norms over ranges of θ."""
