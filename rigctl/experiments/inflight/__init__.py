"""In-flight calibration of a drag-free differential accelerometer: sessions, estimates, model, result."""
