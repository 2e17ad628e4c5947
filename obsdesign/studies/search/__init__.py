"""Brackets of dwell times, periods and windows."""
