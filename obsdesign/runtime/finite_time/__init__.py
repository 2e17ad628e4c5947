"""Finite-time observers at run time: a window of samples."""
