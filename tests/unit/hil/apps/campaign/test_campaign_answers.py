"""Answers of a campaign: intervals, groups of values, margins, worst cases, JUnit and the page."""

from __future__ import annotations

import csv
import json
import shlex
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from hil.apps.campaign.campaign import Campaign, Progress
from hil.apps.campaign.cases.campaign_file import CampaignFile, CampaignSpec, Stop
from hil.apps.campaign.cases.plan import Plan
from hil.apps.campaign.flight import Limit, Outcome
from hil.apps.campaign.results.again import replay_command, run_command
from hil.apps.campaign.results.answers import LiveSummary, facts_of, write_results
from hil.apps.campaign.results.groups import OTHERS, Groups, groups_of
from hil.apps.campaign.results.junit import junit_cases
from hil.apps.campaign.results.page import write_page
from hil.apps.campaign.results.statistics import Tally, wilson
from hil.apps.campaign.results.summary import MOST_LISTED, Summary, separation
from hil.apps.campaign.results.tables import csv_rows, write_each
from hil.apps.campaign.store import Case, Store
from tests.worlds.synthetic_campaign import campaign_file, facts, fill


# Newcombe, Stat. Med. 17 (1998), table I, method 3: the score interval without continuity correction.
@pytest.mark.parametrize(
    ("passed", "trials", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_intervals_are_those_published(passed: int, trials: int, low: float, high: float) -> None:
    assert wilson(passed, trials)[::2] == pytest.approx((low, high), abs=5e-5)
    assert wilson(trials - passed, trials)[::2] == pytest.approx((1 - high, 1 - low), abs=5e-5)


def test_the_interval_of_a_rate_of_one_or_zero_ends_there_exactly() -> None:
    for trials in range(1, 1001):
        assert wilson(trials, trials)[2] == 1.0
        assert wilson(0, trials)[0] == 0.0


def groups(**spec: object) -> Groups:
    return groups_of(CampaignSpec.model_validate(spec))[0]


def test_intervals_of_an_axis_have_equal_probability() -> None:
    normal = groups(sampled={"mass": {"normal": [2.0, 0.1]}})
    # quantiles of the standard normal distribution at 0.2, 0.4, 0.6, 0.8
    assert normal.edges == pytest.approx([2 - 0.08416212, 2 - 0.02533471, 2 + 0.02533471, 2 + 0.08416212], abs=1e-5)
    assert [normal.of(x) for x in (1.0, 1.95, 2.0, 2.03, 9.0)] == list(normal.names)
    assert normal.names == ("below 1.916", "1.916 to 1.975", "1.975 to 2.025", "2.025 to 2.084", "from 2.084")
    seeds = groups(axes={"seed": {"first": 1, "count": 1000}})
    counts = [sum(seeds.of(seed) == name for seed in range(1, 1001)) for name in seeds.names]
    assert counts == [200] * 5
    numbers = groups(axes={"height_m": list(range(100, 0, -1))})
    assert [sum(numbers.of(x) == name for x in range(1, 101)) for name in numbers.names] == [20] * 5


def test_few_values_are_groups_of_their_own() -> None:
    assert groups(sampled={"n": {"integers": [3, 5]}}).names == ("3", "4", "5")
    fault = {"sensor": "gps", "at_s": 3}
    choice = groups(sampled={"faults.sensors": {"choice": [[], [fault], [fault]]}})
    assert choice.names == ("[]", "sensor gps, at_s 3")
    assert choice.of([fault]) == "sensor gps, at_s 3"
    many = groups(axes={"name": [f"n{i}" for i in range(100)]})
    assert len(many.names) == 40
    assert many.of("n0") == "n0"
    assert many.of("n99") == OTHERS


def test_clipped_values_leave_no_empty_interval() -> None:
    spec = {"normal": [2.0, 0.1], "within": [1.95, 2.05]}
    assert groups(sampled={"mass": spec}).edges == pytest.approx([1.95, 1.97467, 2.02533, 2.05])
    assert groups(sampled={"mass": {"uniform": [2.0, 2.0]}}).names == ("below 2", "from 2")


def case(name: str, status: str, margin: float | None, wind: float = 0.0) -> Case:
    limits = () if margin is None else (Limit("max_cross_track_m", 1.0 - margin, 1.0, "m", margin >= 0),)
    reasons = ("too far",) if status == "FAIL" else ()
    error = "LockstepLost" if status == "ERROR" else ""
    return Case(name, 0, {"wind": wind}, Outcome(status, reasons, error, "lost <a\x00b>", limits), ("seed=1",))


def test_the_worst_come_first_and_the_list_is_bounded() -> None:
    cases = [case(f"{n:03}", "PASS", n / 1000) for n in range(500)]
    cases += [case("f1", "FAIL", -0.5), case("f2", "FAIL", None), case("f3", "FAIL", -0.9), case("e", "ERROR", None)]
    summary = Summary.of([], cases)
    assert [c.id for c in summary.worst][:5] == ["f3", "f1", "f2", "000", "001"]
    assert len(summary.worst) == 20
    assert [c.id for c in summary.broken] == ["e"]
    many = Summary.of([], [case(f"{n:04}", "FAIL", -n / 1000) for n in range(1000)])
    assert [c.id for c in many.worst] == [f"{999 - n:04}" for n in range(MOST_LISTED)]
    margins = summary.data()["margins"]["max_cross_track_m"]
    assert margins["cases"] == 502
    assert margins["missed"] == 2
    assert margins["min"] == pytest.approx(-0.9)
    assert margins["p50"] == pytest.approx(0.248, abs=0.002)


def test_errors_and_flakes_are_in_no_rate() -> None:
    of = Groups("wind", (0.0,))
    summary = Summary.of([of], [case("a", "PASS", 0.1, -1.0), case("b", "ERROR", None, -1.0), case("c", "FAIL", -1, 1)])
    below = summary.data()["axes"]["wind"]["below 0"]
    assert (below["cases"], below["pass"], below["fail"]) == (2, 1, 0)
    assert below["pass_rate"][1] == 1.0
    assert separation(summary.rates["wind"].values()) < 0  # one flight each says nothing
    assert separation([Tally(passed=50), Tally(failed=50)]) == pytest.approx(wilson(50, 50)[0] - wilson(0, 50)[2])


@pytest.fixture(scope="module")
def invented(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, CampaignFile, Store]]:
    folder = tmp_path_factory.mktemp("campaign")
    file = campaign_file(folder, 250)
    with Store(folder) as store:
        fill(store, file)
        yield folder, file, store


def test_the_planted_weakness_is_the_first_axis_and_pair(invented: tuple[Path, CampaignFile, Store]) -> None:
    _, file, store = invented
    summary = Summary.of(groups_of(file.spec), store.cases())
    by = {axis: separation(rates.values()) for axis, rates in summary.rates.items()}
    assert sorted(by, key=by.__getitem__)[-2:] == ["autopilot.binary", "wind.steady_W_mps.0"]
    pair = max(summary.pairs, key=lambda pair: separation(summary.pairs[pair].values()))
    assert set(pair) == {"autopilot.binary", "wind.steady_W_mps.0"}
    assert summary.tally.cases == sum(tally.cases for tally in summary.rates["scene"].values()) == 1000
    assert all(sum(t.cases for t in rates.values()) == 1000 for rates in summary.pairs.values())


def test_junit_has_a_testcase_for_every_case(invented: tuple[Path, CampaignFile, Store]) -> None:
    folder, file, store = invented
    summary = Summary.of(groups_of(file.spec), store.cases())
    write_each(store.cases(), junit_cases(folder / "junit.xml", file.name, summary, Path("my bench.yaml")))
    root = ET.parse(folder / "junit.xml").getroot()
    suite = root[0]
    tests = {test.find("properties/property[@name='case']").attrib["value"]: test for test in suite}  # type: ignore[union-attr]
    tally = summary.tally
    assert (root.tag, suite.tag, len(suite), suite.attrib["tests"]) == ("testsuites", "testsuite", 1000, "1000")
    assert len({test.attrib["name"] for test in suite}) == 1000
    assert len(list(suite.iter("failure"))) == tally.failed + tally.flakes == int(suite.attrib["failures"])
    assert len(list(suite.iter("error"))) == tally.errors == int(suite.attrib["errors"])
    for found in store.cases():
        test = tests[found.id]
        properties = {p.attrib["name"]: p.attrib["value"] for p in test.iter("property")}
        assert properties["scene"] == found.axes["scene"]
        assert "margin" in properties or found.status == "ERROR"
        inner = [*test.iter("failure"), *test.iter("error")]
        kinds = {"PASS": [], "FAIL": ["limit"], "FLAKE": ["flake"], "ERROR": ["LockstepLost"]}
        assert [element.attrib["type"] for element in inner] == kinds[found.status]
        if found.status == "FAIL":
            assert found.reason in inner[0].attrib["message"]
            words = shlex.split((inner[0].text or "").splitlines()[-1])
            assert words[:3] == ["hil", "run", "my bench.yaml"]
            assert words[4::2] == list(found.texts)


def test_an_axis_named_like_a_measurement_has_the_column(tmp_path: Path) -> None:
    outcome = Outcome("PASS", limits=(Limit("gust_mps", 3.0, None, "m/s", None),))
    cases = [Case("a", 0, {"gust_mps": "strong"}, outcome, ())]
    write_each(cases, csv_rows(tmp_path / "results.csv", ["gust_mps"], ["gust_mps"]))
    assert (tmp_path / "results.csv").read_text().splitlines()[1] == "a,PASS,strong,,,,"


def test_a_spreadsheet_runs_no_cell(tmp_path: Path) -> None:
    """Texts that begin as formulas do get an apostrophe; numbers stay numbers, also those given as text."""
    formulas = ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(1)", "\t=1", "\r=1", "-", "+", "\uff1d1", "-inf", "-1e5x"]
    plain = [
        "a\r=1",
        "-3",
        "+4.5",
        "-.5e-3",
        "-1.",
        "2",
        "wind",
        "",
        "a=1",
        "'quoted",
        -7,
        -2.5e-9,
        None,
        True,
        [-1, 2],
    ]
    axes = {f"=axis{number}": value for number, value in enumerate([*formulas, *plain])}
    error = Outcome("ERROR", error_type="=HYPERLINK(1)", limits=(Limit("@name", -1.0, None, "m", None),))
    write_each([Case("a", 0, axes, error, ())], csv_rows(tmp_path / "results.csv", axes, ["@name"]))
    with (tmp_path / "results.csv").open(encoding="utf-8", newline="") as file:
        header, row = csv.reader(file)
    cells = dict(zip(header, row, strict=True))
    assert [cells[f"'=axis{number}"] for number in range(len(formulas))] == [
        "'" + text.replace("\r", "\n") for text in formulas
    ]
    texts = ["a\n=1", *map(str, plain[1:-3]), "", "true", "[-1, 2]"]
    assert [cells[f"'=axis{number + len(formulas)}"] for number in range(len(plain))] == texts
    assert (cells["reason"], cells["'@name"]) == ("'=HYPERLINK(1)", "-1.0")


def test_junit_is_xml_whatever_an_error_says(tmp_path: Path) -> None:
    cases = [case("e", "ERROR", None)]
    write_each(cases, junit_cases(tmp_path / "junit.xml", 'a "name" & <more>', Summary.of([], cases), None))
    (error,) = ET.parse(tmp_path / "junit.xml").getroot().iter("error")
    assert error.attrib["message"] == "lost <a\ufffdb>"


def test_the_page_names_failures_and_how_to_fly_them_again(invented: tuple[Path, CampaignFile, Store]) -> None:
    folder, file, store = invented
    summary = Summary.of(groups_of(file.spec), store.cases())
    worst = summary.worst[0]
    recorded = folder / "cases" / worst.id
    recorded.mkdir(parents=True)
    (recorded / "report.html").write_text("")
    write_page(facts(file, folder), summary)
    page = (folder / "report.html").read_text()
    assert f"href='cases/{worst.id}/report.html'" in page
    assert shlex.quote(str(recorded)) in page
    assert "no answer to tick 17 &lt;within&gt; 5 s" in page
    assert page.count("<tr><td><b class='mark fail'>") == min(MOST_LISTED, summary.tally.failed)
    assert "http" not in page.replace("http-equiv", "")  # nothing is fetched
    assert len(page) < 1_000_000


def test_a_campaign_without_a_case_has_a_page(tmp_path: Path) -> None:
    file = campaign_file(tmp_path, 1)
    write_page(facts(file, tmp_path), Summary.of(groups_of(file.spec), []))
    assert "no flight was judged" in (tmp_path / "report.html").read_text()


def test_commands_survive_a_shell() -> None:
    texts = ('faults.sensors=[{"sensor": "gps"}]', "mission=it's $HOME.plan")
    assert shlex.split(run_command(None, texts)) == ["hil", "run", "--set", texts[0], "--set", texts[1]]
    assert yaml.safe_load(texts[0].partition("=")[2]) == [{"sensor": "gps"}]
    assert shlex.split(replay_command(Path("a b/cases/x"))) == ["hil", "replay", "a b/cases/x"]


def test_campaign_json_tells_of_a_campaign_that_goes_on(tmp_path: Path) -> None:
    file = campaign_file(tmp_path, 2)
    states: list[Progress] = []
    with Store(tmp_path) as store:
        fill(store, file)
        campaign = Campaign(file, Plan(file), store, None, tmp_path, Stop())  # type: ignore[arg-type]
        live = LiveSummary(tmp_path, states.append, lambda: facts_of(campaign))
        for done in range(3):
            live(Progress("flights", done, 8, Tally(passed=done)))
        going_on = json.loads((tmp_path / "campaign.json").read_text())
        campaign.unfinished = False
        tally = write_results(campaign).tally
    assert [state.done for state in states] == [0, 1, 2]
    assert (going_on["complete"], going_on["exit_status"]) == (False, None)
    assert going_on["doing"] == {"phase": "flights", "done": 0, "total": 8}  # the later ones came within the period
    ended = json.loads((tmp_path / "campaign.json").read_text())
    assert set(going_on) < set(ended)
    assert (ended["schema"], ended["cases"], ended["complete"], ended["doing"]) == (1, 8, True, None)
    assert (tally.cases, ended["exit_status"]) == (8, tally.exit_status)
    assert {"results.csv", "results.jsonl", "junit.xml", "report.html"} <= {path.name for path in tmp_path.iterdir()}
