"""Measurement procedures: they ask the interfaces, never an instrument."""
