"""Results and recordings as the objects of other people's packages: the extra `notebook`."""
