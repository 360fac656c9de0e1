"""One package each: conditions, observables, baseline model, result."""
