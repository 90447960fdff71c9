"""`python -m hil.cli`: the `hil` command."""

from hil.entry import main

main()
