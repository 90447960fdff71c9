"""Search with optuna against an oracle: the same trials for any number of workers, what is told, and messages."""

from __future__ import annotations

import io
import json
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from hil.apps.campaign.command import CampaignOptions, run_campaign
from hil.apps.campaign.find import command
from hil.apps.campaign.find.command import SearchOptions, search_failures
from hil.apps.campaign.find.search import objective
from hil.apps.campaign.flight import Limit, Outcome
from hil.apps.campaign.store import Store
from hil.config import Bench
from signals.errors import ConfigError, HilError
from tests.worlds.oracle_engine import PASS, OracleEngine, failure

SPEC = """
settings: {wind: {steady_W_mps: [0, 0, 0]}}
axes: {seed: {first: 5, count: 3}, scene: [airfield]}
sampled:
  wind.steady_W_mps.0: {uniform: [-8, 8]}
  faults.sensors: {choice: [[], [{sensor: gps, kind: dropout, at_s: 5}]]}
"""
needs_optuna = pytest.mark.skipif(find_spec("optuna") is None, reason="optuna is not installed")


def corner(bench: Bench) -> Outcome:
    """Return a margin that falls with the wind from the west, faster in a dropout, to a failure above 6 m/s."""
    assert bench.config.wind is not None
    cross_m = 0.6 + bench.config.wind.steady_W_mps[0] / 40 * (2.7 if bench.config.faults.sensors else 1)
    limits = (Limit("max_cross_track_m", cross_m, 1.0, "m", True),)
    return failure(cross_m) if cross_m > 1.0 else Outcome("PASS", limits=limits, digest="p", repeatable=True)


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(SPEC)
    return path


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> list[OracleEngine]:
    """Replace the local engine; the engines that were made are in the list."""
    made: list[OracleEngine] = []

    def make(workers: int, **_: Any) -> OracleEngine:
        made.append(OracleEngine(corner, workers, order=workers))
        return made[-1]

    monkeypatch.setattr(command, "LocalEngine", make)
    return made


def search(spec: Path, out: Path, **options: Any) -> int:
    return search_failures(spec, SearchOptions(out=out, quiet=True, **options), Console(quiet=True))


@needs_optuna
def test_the_same_search_for_any_number_of_workers(spec: Path, tmp_path: Path, engine: list[OracleEngine]) -> None:
    tables = []
    for workers in (1, 3, 20):
        out = tmp_path / str(workers)
        assert search(spec, out, workers=workers, trials=60, seed=2) == 1
        tables.append((out / "results.csv").read_bytes() + (out / "results.jsonl").read_bytes())
    assert tables[0] == tables[1] == tables[2]
    summary = json.loads((tmp_path / "1" / "campaign.json").read_text())
    first = summary["search"]["first_failure"]
    assert summary["fail"] >= 1
    assert first["trial"] <= summary["search"]["trials"] < first["trial"] + 8, "it ends after the batch"
    with Store(tmp_path / "1") as store:
        (found,) = (case for case in store.cases() if case.id == first["case"])
        assert found.status == "FAIL"
        assert found.axes["wind.steady_W_mps.0"] > 5.9
        assert found.axes["seed"] in (5, 6, 7)

    with pytest.raises(ConfigError, match="--resume"):
        search(spec, tmp_path / "1", trials=60)
    with pytest.raises(ConfigError, match="holds 'small-search', and this is 'small'"):
        run_campaign(spec, CampaignOptions(out=tmp_path / "1", resume=True, quiet=True), Console(quiet=True))
    assert search(spec, tmp_path / "1", workers=1, trials=60, seed=2, resume=True) == 1
    assert not engine[-1].flown, "nothing is flown twice"


@needs_optuna
def test_all_trials_are_made_and_skipped_points_are_not_flown(
    spec: Path, tmp_path: Path, engine: list[OracleEngine]
) -> None:
    spec.write_text(SPEC + "samples: 50\nskip: [{wind.steady_W_mps.0: {below: 0}}]\n")
    assert search(spec, tmp_path / "out", workers=1, trials=20, batch=7, sampler="random", every=True) == 1
    with Store(tmp_path / "out") as store:
        winds = [case.axes["wind.steady_W_mps.0"] for case in store.cases()]
    assert 0 < len(winds) < 20
    assert min(winds) > 0


@needs_optuna
@pytest.mark.slow
def test_the_search_gains_on_random_sampling(spec: Path, tmp_path: Path, engine: list[OracleEngine]) -> None:
    spec.write_text(SPEC.replace("[-8, 8]", "[-50, 8]").replace("choice: [[], ", "choice: [[], [], [], [], [], [], "))
    needed = {"tpe": 0, "random": 0}
    for sampler in needed:
        for seed in (1, 2):
            out = tmp_path / f"{sampler}{seed}"
            search(spec, out, workers=4, trials=160, sampler=sampler, seed=seed)
            told = json.loads((out / "campaign.json").read_text())["search"]
            assert told["first_failure"] is not None or sampler == "random"
            needed[sampler] += told["trials"]
    assert 1.3 * needed["tpe"] < needed["random"], needed


def test_objective() -> None:
    def outcome(status: str, *margins: float, reason: str = "x") -> Outcome:
        return Outcome(status, (reason,), limits=tuple(Limit("a", 1 - m, 1.0, "", m >= 0) for m in margins))

    assert objective(outcome("PASS", 0.5, 0.2)) == pytest.approx(0.2)
    assert objective(outcome("FAIL", 0.5, -0.2)) == pytest.approx(-0.2)
    assert objective(outcome("FAIL", 0.5)) == objective(outcome("FAIL")) == float("-inf")
    assert objective(outcome("PASS")) == 1.0
    assert objective(outcome("ERROR")) is None
    late = replace(outcome("FAIL", 0.5), reasons=("the gust never began",), unmet=("the gust never began",))
    assert objective(late) is None
    assert objective(replace(late, reasons=("crashed", *late.reasons))) == float("-inf")
    assert objective(replace(outcome("PASS", 0.5), flown=False)) is None


@needs_optuna
@pytest.mark.parametrize("always", [True, False])
@pytest.mark.parametrize("reasons", [("the gust never began",), ()])
def test_trials_that_did_not_meet_what_they_declare_are_no_failure(
    spec: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, always: bool, reasons: tuple[str, ...]
) -> None:
    """It said "no failure found", and ended with status 1; of vehicles that never flew (no reasons) with status 0."""
    late = Outcome("FAIL" if reasons else "PASS", reasons, digest="l", repeatable=True)
    late = replace(late, unmet=("the gust never began",), flown=bool(reasons))
    engine = OracleEngine(lambda bench: late if always or bench.config.faults.sensors else PASS, 2)
    monkeypatch.setattr(command, "LocalEngine", lambda *_, **__: engine)
    said = io.StringIO()
    out = tmp_path / "out"
    status = search_failures(spec, SearchOptions(out=out, quiet=True, trials=16), Console(file=said, width=300))
    assert status == json.loads((out / "campaign.json").read_text())["exit_status"] == (3 if always else 0)
    assert "trials without what was declared, such as the gust never began" in said.getvalue()
    assert said.getvalue().endswith(f"{'no trial says anything about the vehicle' if always else 'no failure found'}\n")


@needs_optuna
def test_a_bench_that_always_breaks_ends_the_search(spec: Path, tmp_path: Path, monkeypatch: Any) -> None:
    broken = OracleEngine(lambda _: Outcome("ERROR", error_type="LockstepLost", error="no answer"), 2)
    monkeypatch.setattr(command, "LocalEngine", lambda *_, **__: broken)
    with pytest.raises(HilError, match="all 8 flights of a batch are an ERROR, the first: LockstepLost: no answer"):
        search(spec, tmp_path / "out", trials=100)


def test_what_is_missing_is_told(spec: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    if find_spec("optuna") is not None:
        with pytest.raises(ConfigError, match=r"'annealing' \(tpe, gp, random\)"):
            search(spec, out, sampler="annealing")
        monkeypatch.setitem(sys.modules, "torch", None)
        with pytest.raises(ConfigError, match=r"--sampler gp: needs PyTorch .*--sampler tpe"):
            search(spec, out, sampler="gp")
        spec.write_text("settings: {seed: 2}\n")
        with pytest.raises(ConfigError, match=r"small\.yaml: varies nothing to search in"):
            search(spec, out)
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(ConfigError, match=r"needs optuna .*pip install 'hil-bench\[campaign\]'"):
        search(spec, out)
    assert not out.exists()
