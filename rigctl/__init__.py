"""rigctl: instrument control and model building for precision accelerometer calibration."""
