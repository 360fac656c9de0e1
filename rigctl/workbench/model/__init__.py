"""Versions of a model, and how its errors fell."""
