"""Entry point of `python -m hil_companion`."""

import sys

from hil_companion.command import main

sys.exit(main())
