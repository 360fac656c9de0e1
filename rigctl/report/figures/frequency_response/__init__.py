"""Figures of the frequency response."""
