"""Full column rank of stacks of flows and jumps over a box of spacings."""
