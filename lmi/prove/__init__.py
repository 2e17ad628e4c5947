"""Provers: certificates checked for all θ in ball arithmetic, without any solver."""
