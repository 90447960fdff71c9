"""Rules that end a campaign early. They look at the cases in the order of the plan, not in the order of their ends.

So a campaign that is stopped has the same table for any number of workers: that of the shortest part of the plan on
which the rule holds. Only the rule of time depends on the machine.
"""

from __future__ import annotations

from hil.apps.campaign.cases.campaign_file import Stop
from hil.apps.campaign.results.statistics import Tally
from signals.errors import ConfigError

_FORMS = "failure, width=0.05, above=0.95, below=0.5, or a time such as 90s, 30m, 2h"
_UNITS_S = {"s": 1.0, "m": 60.0, "h": 3600.0}


def stop_reason(stop: Stop, tally: Tally) -> str:
    """Return why a campaign with these results ends, empty if it goes on."""
    if stop.failure and tally.cases > tally.passed:
        return "the first case that is not a PASS"
    low, _, high = tally.interval()
    if not tally.judged:
        return ""
    if stop.interval_width is not None and high - low < stop.interval_width:
        return f"the pass rate is known to {high - low:.3g}, less than {stop.interval_width:g}"
    if stop.rate_above is not None and low > stop.rate_above:
        return f"the pass rate is above {stop.rate_above:g}: at least {low:.3f}"
    if stop.rate_below is not None and high < stop.rate_below:
        return f"the pass rate is below {stop.rate_below:g}: at most {high:.3f}"
    return ""


def parse_stop(texts: tuple[str, ...], base: Stop) -> Stop:
    """Return `base` with the texts of `--stop-after` over it. Raises ConfigError."""
    changes: dict[str, object] = {}
    keys = {"width": "interval_width", "above": "rate_above", "below": "rate_below"}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            if text == "failure":
                changes["failure"] = True
            elif name in keys:
                changes[keys[name]] = float(number)
            else:
                changes["time_s"] = float(text[:-1]) * _UNITS_S[text[-1:]]
        except (ValueError, KeyError):
            raise ConfigError.at(f"--stop-after {text}", "is not understood", _FORMS) from None
    try:
        return Stop(**{**base.model_dump(), **changes})
    except ValueError:
        raise ConfigError.at("--stop-after", "has a value out of range", _FORMS) from None
