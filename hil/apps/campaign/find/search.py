"""Looks for failures with optuna: it proposes values of the axes, and is told the smallest margin of each flight.

The space is that of the campaign's file. A sampled number is proposed by its probability 0..1, so that the sampler
begins with the distribution of the file; values of a choice and of a crossed axis begin equally likely. `repeats` does
not apply. Trials are asked for and told in batches of a fixed size and in order, so a search repeats exactly for any
number of workers.

A model alone stays for hundreds of trials near a small margin that leads to no failure: TPE with the best choice, GP at
one point. So every second trial is random, and a search needs at most about twice as many trials as random sampling,
wherever the margins lead. TPE's model of good trials is made of the best two.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from itertools import cycle
from typing import Any

from hil.apps.campaign.cases.campaign_file import CampaignFile, Range
from hil.apps.campaign.cases.distributions import Distribution
from hil.apps.campaign.cases.plan import Plan, Point
from hil.apps.campaign.find.trials import Trial, Trials
from hil.apps.campaign.flight import Outcome
from hil.apps.campaign.results.statistics import Tally
from hil.apps.campaign.store import Store
from signals.errors import ConfigError, HilError

INSTALL = "pip install 'hil-bench[campaign]'"
UNJUDGED = 1.0  # objective of a PASS in which nothing was judged: as far from a limit as can be
SAMPLERS = ("tpe", "gp", "random")
_INSIDE = 2.0**-53  # of the open interval of probabilities
_STARTUP = 10  # trials before the model of TPE has a say
_GOOD = 2  # trials that TPE's model calls good


class Search:
    """One search. `show` is called after every batch."""

    def __init__(self, file: CampaignFile, plan: Plan, sampler: str, seed: int) -> None:
        """Raises ConfigError if there is nothing to search, or what `sampler` needs is not installed."""
        self._optuna = _optuna()
        if not plan.axes:
            text = "varies nothing to search in"
            raise ConfigError.at(file.document.source, text, "give axes in the section axes or sampled")
        self._file, self._plan = file, plan
        self._space = _space(self._optuna, file)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # some options are called experimental
            samplers = _samplers(self._optuna, sampler, seed)
        self._samplers = cycle(samplers)
        self._study = self._optuna.create_study(sampler=samplers[0])
        self.first: tuple[int, Trial] | None = None  # number and trial of the first failure
        self.smallest: Trial | None = None  # with the smallest objective
        self.tried = 0
        self.ended = False  # by a failure or the number of trials
        self.tally = Tally()  # of the cases
        self.unmet: list[str] = []  # of each trial that says nothing for want of what was declared, the first text
        self.show: Callable[[], None] = lambda: None

    def run(self, trials: Trials, store: Store, *, count: int, batch: int, every: bool) -> None:
        """Make `count` trials, or end after the batch with the first failure unless `every`. Raises HilError."""
        store.begin_plan(self._file.bench_path, self._plan.base)
        while self.tried < count and (every or self.first is None):
            self._batch(trials, store, min(batch, count - self.tried))
            self.show()
        self.ended = True

    @property
    def exit_status(self) -> int:
        """0: no failure was found; 1: one was; 3: an ERROR, or no trial says anything about the vehicle."""
        if self.tally.errors or self.smallest is None:
            return 3
        return 0 if self.first is None else 1

    def _batch(self, trials: Trials, store: Store, size: int) -> None:
        asked = [self._ask() for _ in range(size)]
        points = [self._point(trial.params, self.tried + i) for i, trial in enumerate(asked)]
        chosen = [i for i, point in enumerate(points) if not self._plan.is_skipped(point.values)]
        made = dict(zip(chosen, trials.make([points[i].texts for i in chosen]), strict=True))
        for i, (trial, point) in enumerate(zip(asked, points, strict=True)):
            self._tell(trial, point, made.get(i), store)
        self.tried += size
        judged = [trial for trial in made.values() if trial.outcome.status != "ERROR"]
        if made and not judged:
            raise _all_errors([trial.outcome for trial in made.values()])

    def _ask(self) -> Any:
        self._study.sampler = next(self._samplers)
        return self._study.ask(self._space)

    def _tell(self, asked: Any, point: Point, made: Trial | None, store: Store) -> None:
        value = None if made is None else objective(made.outcome)
        if value is None or made is None:  # not flown, or it says nothing about the vehicle
            self._study.tell(asked, state=self._optuna.trial.TrialState.FAIL)
            if made is not None and made.outcome.status != "ERROR":
                self.unmet.append(made.outcome.unmet[0])
        else:
            self._study.tell(asked, value)
            if self.smallest is None or value < (objective(self.smallest.outcome) or 0.0):
                self.smallest = made
            if made.outcome.status == "FAIL" and self.first is None:
                self.first = point.number, made
        if made is not None:
            if store.outcome(made.case) is None:
                store.put(made.case, made.outcome, point.texts)  # a bench that cannot be loaded
            if store.add_point(point.number, made.case, point.values):
                self.tally.add(made.outcome.status)

    def _point(self, params: dict[str, Any], number: int) -> Point:
        spec, values = self._file.spec, {}
        for name, axis in spec.axes.items():
            values[name] = axis.first + axis.step * params[name] if isinstance(axis, Range) else axis[params[name]]
        for name, distribution in spec.sampled.items():
            values[name] = _value(distribution, params[name])
        return self._plan.at(values, number)


def objective(outcome: Outcome) -> float | None:
    """Return the number that a search makes as small as possible; None: the flight says nothing about the vehicle.

    It is the smallest margin. A FAIL whose margins do not tell it, such as a crash, is below every margin; one for no
    other reason than a fault that did not come says nothing, and neither does a PASS of a vehicle that never flew.
    """
    unmet = outcome.reasons and set(outcome.reasons) <= set(outcome.unmet)
    if outcome.status == "ERROR" or not outcome.flown or unmet:
        return None
    worst = outcome.worst
    margin = None if worst is None else worst.margin
    if outcome.status == "FAIL":
        return margin if margin is not None and margin < 0.0 else float("-inf")
    return UNJUDGED if margin is None else margin


def _optuna() -> Any:
    try:
        import optuna
    except ImportError as error:
        raise ConfigError.at("hil campaign search", f"needs optuna ({error})", INSTALL) from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna


def _samplers(optuna: Any, name: str, seed: int) -> list[Any]:
    """Return the samplers that take turns."""
    of = optuna.samplers
    if name == "random":
        return [of.RandomSampler(seed=seed)]
    anywhere = of.RandomSampler(seed=(seed + 1) % 2**32)
    if name == "tpe":
        model = of.TPESampler(
            seed=seed, multivariate=True, constant_liar=True, n_startup_trials=_STARTUP, gamma=lambda _: _GOOD
        )
        return [anywhere, model]
    if name == "gp":
        try:
            import torch  # noqa: F401
        except ImportError as error:
            hint = "pip install torch, or use --sampler tpe"
            raise ConfigError.at("--sampler gp", f"needs PyTorch ({error})", hint) from None
        return [anywhere, of.GPSampler(seed=seed, deterministic_objective=True)]
    raise ConfigError.at("--sampler", f"is unknown: {name!r}", ", ".join(SAMPLERS))


def _space(optuna: Any, file: CampaignFile) -> dict[str, Any]:
    """Return the distributions that optuna proposes from: indices, whole numbers and probabilities."""
    d = optuna.distributions
    space: dict[str, Any] = {}
    for name, axis in file.spec.axes.items():
        if isinstance(axis, Range):
            space[name] = d.IntDistribution(0, axis.count - 1)
        else:
            space[name] = d.CategoricalDistribution(range(len(axis)))
    for name, sampled in file.spec.sampled.items():
        if sampled.choice is not None:
            space[name] = d.CategoricalDistribution(range(len(sampled.choice)))
        elif sampled.integers is not None:
            space[name] = d.IntDistribution(*sampled.integers)
        else:
            space[name] = d.FloatDistribution(0.0, 1.0)
    return space


def _value(distribution: Distribution, proposed: Any) -> Any:
    if distribution.choice is not None:
        return distribution.choice[proposed]
    if distribution.integers is not None:
        return proposed
    return distribution.value(min(max(proposed, _INSIDE), 1.0 - _INSIDE))


def _all_errors(outcomes: Sequence[Outcome]) -> HilError:
    first = outcomes[0]
    text = f"all {len(outcomes)} flights of a batch are an ERROR, the first: {first.error_type}: {first.error}"
    return HilError(f"the search ends: {text} (try the bench with `hil run`)")
