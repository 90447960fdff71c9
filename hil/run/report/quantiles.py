"""Quantiles of a latency histogram as run.json shows them."""

from __future__ import annotations

from signals.latency import LatencyHistogram


def quantiles_us(histogram: LatencyHistogram) -> dict[str, float]:
    """Return mean, median, 99th percentile and maximum [us]."""
    return {
        "mean": histogram.mean_ns / 1000,
        "p50": histogram.quantile_ns(0.5) / 1000,
        "p99": histogram.quantile_ns(0.99) / 1000,
        "max": histogram.max_ns / 1000,
    }
