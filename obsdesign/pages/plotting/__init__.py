"""Pictures with matplotlib, imported nowhere else."""
