"""Anybody's calibration: a table of readings, and an expression for what is believed of them."""
