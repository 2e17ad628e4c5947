"""What people look at: the report of a design, curves, plots."""
