"""Candidates for the impulsive observer: windows and strategies."""
