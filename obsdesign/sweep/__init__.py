"""Sweeps: the answer of a search or a design over one or two entries of a problem file."""
