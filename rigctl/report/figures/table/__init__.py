"""Figures of a table of readings."""
