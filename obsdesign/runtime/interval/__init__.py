"""Interval observers at run time: enclosed maps, one product per step."""
