"""What the observables should be: baseline and effects."""
