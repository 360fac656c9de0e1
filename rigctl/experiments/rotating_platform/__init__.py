"""Telling acceleration from an accelerometer's own bias by half turns back and forth (Lenoir et al. 2013)."""
