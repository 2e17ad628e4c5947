"""Maps over one or two entries of a problem."""
