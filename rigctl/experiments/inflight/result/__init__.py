"""What the fitted model says of the instrument."""
