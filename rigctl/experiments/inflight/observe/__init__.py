"""From samples to observables with their noise."""
