"""Instrument drivers, one module per instrument, each reading like its manual."""
