"""The point observer with jump gains at run time."""
