"""The page of a campaign in a real browser: from its folder, and served by the dashboard beside the list of campaigns.

Screenshots are written to the folder in HIL_SCREENSHOTS, if set.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.apps.campaign.campaign import Campaign
from hil.apps.campaign.cases.campaign_file import Stop
from hil.apps.campaign.cases.plan import Plan
from hil.apps.campaign.results.answers import write_results
from hil.apps.campaign.results.summary import MOST_BROKEN, MOST_LISTED
from hil.apps.campaign.store import Store
from tests.worlds.bench_process import Hil
from tests.worlds.chromium import chromium, needs_chromium, open_dashboard, patient
from tests.worlds.synthetic_campaign import campaign_file, fill

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = needs_chromium


@pytest.fixture
def tab() -> Iterator[Any]:
    """A page that fails the test if the browser complains."""
    with chromium() as browser:
        opened = patient(browser.new_context(viewport={"width": 1280, "height": 900})).new_page()
        wrong: list[str] = []
        opened.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        opened.on("pageerror", lambda error: wrong.append(str(error)))
        yield opened
        assert wrong == []


def make_campaign(folder: Path, samples: int) -> Campaign:
    """Write the results of a synthetic campaign of 4 cases a sample, with the report of its worst case."""
    folder.mkdir(parents=True)
    file = campaign_file(folder, samples)
    with Store(folder) as store:
        fill(store, file)
        campaign = Campaign(file, Plan(file), store, None, folder, Stop(), unfinished=False)  # type: ignore[arg-type]
        worst = min(
            store.cases(), key=lambda case: (case.status != "FAIL", case.outcome.worst and case.outcome.worst.margin)
        )
        recorded = folder / "cases" / worst.id
        recorded.mkdir(parents=True)
        (recorded / "report.html").write_text(
            "<title>one flight</title><link rel='icon' href='data:,'><p>one flight</p>"
        )
        write_results(campaign)
    return campaign


def open_and_search(tab: Any, address: str) -> None:
    """Open the page, search its list of failures, and follow the link to the worst flight."""
    tab.goto(address)
    rows = tab.locator(".list").last.locator("tr:has(td)")
    count = rows.count()
    tab.locator("input[type=search]").last.fill("b.elf city_park")
    shown = rows.filter(visible=True).count()
    assert 0 < shown < count
    assert tab.locator(".list").last.locator("p span").inner_text() == f"{shown} of {count}"
    tab.locator("input[type=search]").last.fill("")
    rows.first.locator("summary").click()
    assert rows.first.locator("code", has_text="hil replay").is_visible()
    assert rows.first.locator("code", has_text="hil run").is_visible()
    folder = os.environ.get("HIL_SCREENSHOTS")
    if folder:
        tab.screenshot(path=f"{folder}/campaign.png", full_page=True)
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    tab.set_viewport_size({"width": 390, "height": 844})  # a phone
    outside = "e => !e.closest('.card, .scroll') && e.getBoundingClientRect().right > innerWidth"
    assert tab.evaluate(f"[...document.querySelectorAll('body *')].filter({outside}).length") == 0
    tab.set_viewport_size({"width": 1280, "height": 900})
    rows.first.locator("a").click()
    tab.wait_for_selector("text=one flight")


@pytest.mark.slow
def test_the_page_of_ten_thousand_cases_is_small(tab: Any, tmp_path: Path) -> None:
    make_campaign(tmp_path / "many", 2500)
    open_and_search(tab, (tmp_path / "many" / "report.html").as_uri())
    tab.go_back()
    listed = tab.locator(".list tr:has(td)").count()
    assert MOST_LISTED < listed <= MOST_LISTED + MOST_BROKEN
    assert tab.evaluate("document.querySelectorAll('*').length") < 15_000
    assert (tmp_path / "many" / "report.html").stat().st_size < 1_000_000


@pytest.mark.slow
def test_the_dashboard_lists_campaigns_and_serves_their_pages(tab: Any, tmp_path: Path) -> None:
    make_campaign(tmp_path / "campaigns" / "wind", 60)
    live = tmp_path / "campaigns" / "live"
    live.mkdir()
    counts = {"schema": 1, "cases": 7, "pass": 5, "fail": 2, "error": 0, "flake": 0, "pass_rate": [0.3, 0.7, 0.9]}

    def write(done: int) -> None:
        doing = {"phase": "flights", "done": done, "total": 5000}
        text = json.dumps({**counts, "complete": False, "doing": doing})
        (live / "part").write_text(text)
        (live / "part").replace(live / "campaign.json")

    write(7)
    hil = Hil(tmp_path, "dash", "--port", "0")
    try:
        open_dashboard(tab, hil.address)
        tab.click("#tab-runs")
        tab.wait_for_selector("tr[data-campaign=live] >> text=flights: 7 of 5,000")
        write(8)
        tab.wait_for_selector("tr[data-campaign=live] >> text=flights: 8 of 5,000")  # without a click
        assert "71.4" not in tab.inner_text("tr[data-campaign=live]")
        assert "70.0 % (30.0 % to 90.0 %)" in tab.inner_text("tr[data-campaign=live]")
        assert tab.locator("tr[data-campaign=live] a").count() == 0
        if folder := os.environ.get("HIL_SCREENSHOTS"):
            tab.screenshot(path=f"{folder}/campaigns.png")
        link = tab.locator("tr[data-campaign=wind] a").get_attribute("href")
        open_and_search(tab, hil.address.rstrip("/") + link)
        tab.go_back()
        with tab.expect_download() as download:
            tab.click("a[href='results.csv']")
        assert download.value.path().read_bytes() == (tmp_path / "campaigns" / "wind" / "results.csv").read_bytes()
    finally:
        hil.end()
