"""The plant, what is required of its observer, and the file that states both."""
