"""Exact facts about problems with unknown impulses."""
