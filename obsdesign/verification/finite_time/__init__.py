"""Claims and guarantees of finite-time estimation, proved."""
