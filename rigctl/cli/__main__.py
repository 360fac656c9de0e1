"""`python -m rigctl.cli`."""

from rigctl.cli import main

main()
