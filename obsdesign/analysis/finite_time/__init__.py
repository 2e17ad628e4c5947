"""Enclosures of finite-time gains and the errors they leave."""
