"""Calibration certificates: what leaves the laboratory, and how it is checked afterwards."""
