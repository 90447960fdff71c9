"""Recording of runs: digest, MCAP, telemetry log and the flight track for the report. Never changes the run."""
