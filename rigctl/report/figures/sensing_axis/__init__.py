"""Figures of this experiment."""
