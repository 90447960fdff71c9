"""The `hil` command. Exit status: 0 PASS, 1 FAIL (the vehicle), 2 wrong files or options, 3 ERROR (the bench).

Each command has one file without logic, which imports its application only when the command is called. `hil --help`
therefore loads no numpy, MuJoCo or ZeroMQ.
"""

import hil.own_packages  # noqa: F401 (before every import of a package beside hil)
