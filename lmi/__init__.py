"""Matrix inequalities over a range of dwell times: solved, proved or refuted."""
