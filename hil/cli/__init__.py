"""The `hil` command. Exit status: 0 PASS, 1 FAIL (the vehicle), 2 wrong files or options, 3 ERROR (the bench).

One file for each command, without logic. A command imports what does its work when it is called, so that
`hil --help` loads no numpy, MuJoCo or ZeroMQ.
"""
