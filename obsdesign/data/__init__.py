"""Records of data: read, written, simulated, and run through an observer."""
