"""Choosing what the user left open, one file per kind. Nothing here is believed later."""
