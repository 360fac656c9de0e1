"""Finding an accelerometer's sensing axes by the two-phase null search (Lucente et al. 2022)."""
