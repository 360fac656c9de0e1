"""From samples to numbers with honest noise: sine fits, spectra, least squares, planes, budgets."""
