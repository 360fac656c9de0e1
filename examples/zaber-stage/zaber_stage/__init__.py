"""A Zaber linear stage: driver and simulator, found by rigctl through entry points."""
