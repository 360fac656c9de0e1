"""Figures: one SVG and one CSV each."""
