"""The operator's console: it drives what the commands drive, and nothing can be done only here."""
