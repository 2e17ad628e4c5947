"""Pages and pictures: the report of a design, curves, plots."""
