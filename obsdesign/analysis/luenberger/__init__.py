"""Exact facts about the error of point observers."""
