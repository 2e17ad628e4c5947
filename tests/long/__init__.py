"""Random checks too long for every run: scripts, `python -m tests.long.NAME`."""
