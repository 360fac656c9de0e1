"""Simulated instruments that take and give the real bytes, on one shared world."""
