"""How noise averages: the Allan family with its confidence, the spectral density with what it is made of."""
