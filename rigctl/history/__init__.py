"""A laboratory's stores as a catalogue: the calibrations of an item, their drift, and whether the newest fits."""
