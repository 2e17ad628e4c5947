"""Matrix inequalities over a range of dwell times: found, proved for all of them, or refuted."""
