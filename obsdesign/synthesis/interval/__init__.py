"""Candidates for interval observers: gains, coordinates, forms."""
