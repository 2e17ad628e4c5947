"""Source code of designs."""
