"""`python -m hil.cli`: the `hil` command."""

from hil.cli.entry import main

main()
