"""Names of the files in the folder of a run, and in that of a campaign."""

from __future__ import annotations

BENCH_NAME = "bench.yaml"  # the whole configuration: it repeats the run
RUN_JSON_NAME = "run.json"
PAGE_NAME = "report.html"
MCAP_NAME = "run.mcap"
TLOG_NAME = "flight.tlog"
SUMMARY_NAME = "campaign.json"
