"""Which measurement to make next."""
