"""Trials of what is promised under faults: `python -m tests.reliability --help`; results in docs/reliability.md."""
