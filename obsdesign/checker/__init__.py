"""A program that proves designs again, copied with them; nothing imports it."""
