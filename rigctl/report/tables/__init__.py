"""Tables of results, printed or in a report."""
