"""Names of the files in the folder of a run, and in that of a campaign."""

from __future__ import annotations

BENCH_NAME = "bench.yaml"  # the whole configuration: it repeats the run
RUN_JSON_NAME = "run.json"
PAGE_NAME = "report.html"
MCAP_NAME = "run.mcap"
TLOG_NAME = "flight.tlog"
TRACE_NAME = "companion.jsonl"  # answers of companions, which a replay takes
TIMING_NAME = "companion_timing.csv"
VIEWS_NAME = "companion_views.jsonl"
PEOPLE_NAME = "people.json"
SEARCH_PICTURE_NAME = "search.png"
SUMMARY_NAME = "campaign.json"
