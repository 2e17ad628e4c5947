"""Questions about a problem beyond one design: check, search, comparison, sweep."""
