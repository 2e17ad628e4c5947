"""How many dwell times back and ahead the matrices of a certificate may depend on."""

from __future__ import annotations

from typing import Literal

# 0: one common matrix; AUTO: as many dwell times as it takes
Memory = int | Literal["auto"]
AUTO: Literal["auto"] = "auto"
