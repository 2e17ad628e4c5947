"""Source code of a design for other machines: C99 with tables, a self-test and a manifest."""
