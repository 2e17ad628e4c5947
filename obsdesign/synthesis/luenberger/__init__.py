"""Candidates for the point observer: placement, jump gains, schedules."""
