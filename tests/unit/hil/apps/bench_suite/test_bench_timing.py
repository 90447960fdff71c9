"""Times of benchmarks, which other programs must not move."""

from __future__ import annotations

import os
import time

from hil.apps.bench_suite.timing import best_times, processor_s


def test_time_in_which_others_have_the_processor_does_not_count() -> None:
    times_s = best_times({"waits": lambda: time.sleep(0.2), "works": lambda: sum(range(3_000_000))}, rounds=2)
    assert times_s["waits"] < 0.02
    assert times_s["works"] > times_s["waits"]


def test_the_processor_time_of_a_process_is_its_own() -> None:
    before_s = time.process_time(), processor_s(os.getpid())
    sum(range(3_000_000))
    after_s = time.process_time(), processor_s(os.getpid())
    assert before_s[0] <= before_s[1] <= after_s[1]
    assert after_s[1] - before_s[1] >= 0.5 * (after_s[0] - before_s[0])
