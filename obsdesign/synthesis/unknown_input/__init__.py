"""Candidates for the unknown-input observer."""
