"""Formats of flight logs, one file each: `hil.run.flight_logs.log_format` finds every module here with a `FORMAT`."""
