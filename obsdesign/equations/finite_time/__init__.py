"""Formulas of finite-time estimation (Mazenc, Ahmed)."""
