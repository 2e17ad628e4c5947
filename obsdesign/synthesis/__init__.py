"""Choosing what the user left open, one file per kind. Verification checks all of it."""
