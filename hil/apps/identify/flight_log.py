"""The flight of a log, as the fit takes it: the readers of logs are shared, and so is what they return."""

from hil.run.flight_logs.flight_log import FlightLog, MotorsKind, Series

__all__ = ["FlightLog", "MotorsKind", "Series"]
