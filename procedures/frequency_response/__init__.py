"""Sines of many frequencies and amplitudes on the linear stage, the sensing axis along the motion and against it."""
