"""The papers' formulas, each written once; numpy only, generic over float and exact arrays."""
