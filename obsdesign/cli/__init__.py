"""The command line: commands parse, make one call, print."""
