"""Programs that prove designs again, copied with them; nothing imports them."""
