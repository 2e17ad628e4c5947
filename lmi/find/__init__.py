"""Everything that calls a solver or proposes a certificate; nothing here is a proof."""
