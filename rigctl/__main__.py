"""`python -m rigctl`: the command line, where the script is not on the path."""

from rigctl.cli import main

main()
