"""Name of the trace of companions in a run's folder, for whoever does not load ZeroMQ."""

TRACE_NAME = "companion.jsonl"
