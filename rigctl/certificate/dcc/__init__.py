"""A certificate as a digital calibration certificate: PTB's DCC 3.3.0 with quantities of D-SI 2.2.1."""
