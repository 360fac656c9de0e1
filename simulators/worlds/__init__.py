"""The physics behind the simulated instruments, integrated in the time domain."""
