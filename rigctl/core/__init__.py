"""What every part may know: nothing here knows an instrument, an experiment or a store."""
