"""Pass rates with their uncertainty.

Wilson's score interval at 95 % (E. B. Wilson, J. Am. Stat. Assoc. 22, 1927): with n trials, p the share of passes and
z the normal quantile of 0.975,

    (p + z^2/2n -+ z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n)

ERROR and FLAKE say nothing about the vehicle, so they are in no rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

Z_95 = 1.959963984540054


def wilson(passed: int, trials: int) -> tuple[float, float, float]:
    """Return lower end, estimate and upper end of a rate; (0, nan, 1) without trials."""
    if trials == 0:
        return 0.0, math.nan, 1.0
    p, z2 = passed / trials, Z_95 * Z_95
    centre = (p + z2 / (2 * trials)) / (1.0 + z2 / trials)
    half = Z_95 * math.sqrt(p * (1.0 - p) / trials + z2 / (4.0 * trials * trials)) / (1.0 + z2 / trials)
    # The ends are exact without a failure or a pass; rounded they would be 1e-16 beside.
    return (centre - half if passed else 0.0), p, (centre + half if passed < trials else 1.0)


STATUSES = {"PASS": "passed", "FAIL": "failed", "ERROR": "errors", "FLAKE": "flakes"}  # with their counts in a Tally


@dataclass
class Tally:
    """Counts of the outcomes of a set of cases."""

    passed: int = 0
    failed: int = 0
    errors: int = 0
    flakes: int = 0

    def add(self, status: str) -> None:
        """Count one case."""
        name = STATUSES[status]
        setattr(self, name, getattr(self, name) + 1)

    @property
    def cases(self) -> int:
        return self.passed + self.failed + self.errors + self.flakes

    @property
    def judged(self) -> int:
        """Cases that say something about the vehicle."""
        return self.passed + self.failed

    def interval(self) -> tuple[float, float, float]:
        """Return Wilson's interval of the pass rate: lower end, estimate, upper end."""
        return wilson(self.passed, self.judged)

    @property
    def exit_status(self) -> int:
        """0: every case passed; 1: a FAIL or a FLAKE; 3: an ERROR, or no case at all."""
        if self.errors or not self.cases:
            return 3
        return 1 if self.failed or self.flakes else 0
