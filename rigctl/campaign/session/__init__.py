"""A campaign under way: its steps, its operator, its locks, and what is done after a fault."""
