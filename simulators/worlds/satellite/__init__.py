"""A drag-free satellite with a differential accelerometer: orbit, loops, sensors, noise, for many draws at once."""
