"""One SQLite file per campaign: runs, events, models and fits, every row with its checksum."""
