"""The unknown-input observer at run time, and its differentiators."""
