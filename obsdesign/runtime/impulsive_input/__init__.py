"""Impulses of unknown time and weight at run time, by integrals or by samples."""
