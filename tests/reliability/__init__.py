"""Trials of what rigctl promises under faults: `python -m tests.reliability --help`; results in docs/reliability.md."""
