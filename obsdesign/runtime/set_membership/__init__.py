"""Multiplier observers at run time: a window of stages, multipliers, certified bounds."""
