"""A campaign: what was done, what came back, and how it is kept."""
