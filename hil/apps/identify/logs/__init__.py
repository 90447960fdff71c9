"""Formats of flight logs, one file each: `hil.apps.identify.log_format` finds every module here with a `FORMAT`."""
