"""Candidates for finite-time estimation: injections, windows, periods."""
