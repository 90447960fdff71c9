"""Exit statuses of the `hil` command. 0 is PASS, 1 is FAIL (the vehicle missed its limits)."""

CONFIG_STATUS = 2  # wrong files or options
ERROR_STATUS = 3  # the bench broke
