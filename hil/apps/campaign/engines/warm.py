"""Imports that every flight needs. The server that forks the workers has them once."""

import hil.apps.campaign.flight
import hil.config
import hil.run.bench_run
import hil.run.parts.catalog  # noqa: F401
