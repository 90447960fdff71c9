"""The dashboard in a real browser: start a mission, follow it, fly by hand, inject faults, and replay past runs.

Screenshots are written to the folder in HIL_SCREENSHOTS, if set.
"""

from __future__ import annotations

import json
import os
import re
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.worlds.bench_files import FLIGHT_SENSORS
from tests.worlds.bench_process import Hil
from tests.worlds.chromium import chromium, needs_chromium, open_dashboard, patient
from tests.worlds.patience import PATIENCE_S

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = needs_chromium

SENSORS = f"""
{FLIGHT_SENSORS}  front: {{kind: camera, resolution: [64, 48], fov_deg: 90, rate_hz: 5, channels: [rgb]}}
"""
BENCH = (
    SENSORS
    + """
mission: hop.waypoints
autopilot: {transport: loopback}
record: {mcap: true, tlog: false, report: false}
companion: {start: ["mapper:mapper"], port: 0, rate_hz: 5}
"""
)
MAPPER = """
import numpy as np
from hil_companion import Grid, View

class mapper:
    topics = ("truth",)

    def __call__(self, frame):
        self.p_W = [float(v) for v in np.ravel(frame["truth"]["p_WB"])]

    def view(self):
        cells = np.zeros((40, 60), np.uint8)
        cells[5:35, 5:55], cells[20, 10:50] = 1, 3
        plan = np.array([self.p_W[:2], [5.0, 5.0]])
        return View(self.p_W, 0.5, (5.0, 5.0), plan, plan + 0.2, Grid(cells, (-10.0, -10.0), 0.5))
"""
PAIR = (
    SENSORS
    + """
mission: hop.waypoints
autopilot: {transport: loopback}
record: {mcap: true, tlog: false, report: false}
limits: {max_cross_track_m: null, final_error_m: null, altitude_error_m: null}
vehicles: {lead: {}, wing: {}}
formation: {spacing_m: 4}
"""
)
SIZES = {"desktop": (1280, 800), "tablet": (820, 1180)}
PHONE = (390, 844)


def until(holds: Callable[[], Any], *, page: Any) -> None:
    end = time.monotonic() + 2 * PATIENCE_S  # a flight, which shares the processor with a browser
    while not holds():
        assert time.monotonic() < end, page.inner_text("body")
        page.wait_for_timeout(60)


@pytest.fixture
def address(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[str]:
    (tmp_path / "mapper.py").write_text(MAPPER)
    hil = Hil(tmp_path, "dash", "--port", "0", bench=getattr(request, "param", BENCH))
    yield hil.address
    hil.end()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Any]:
    context = patient(browser.new_context(viewport=dict(zip(("width", "height"), SIZES["desktop"], strict=True))))
    tab = context.new_page()
    wrong: list[str] = []
    tab.on("console", lambda message: wrong.append(message.text) if message.type in ("error", "warning") else None)
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.on("request", lambda request: wrong.append(request.url) if not local(request.url, address) else None)
    tab.add_init_script("navigator.getGamepads = () => (window.pad ? [window.pad] : [null]);")
    tab.add_init_script(
        "window.sockets = []; const Socket = WebSocket;"
        "window.WebSocket = class extends Socket { constructor(url) { super(url); window.sockets.push(this); } };"
    )
    open_dashboard(tab, address)
    yield tab
    context.close()
    # Drivers warn when a canvas is read back, which only this test does; a refused mission is told on the page, too.
    assert [text for text in wrong if not re.search("GPU stall|readback|status of 422", text)] == []


def local(url: str, address: str) -> bool:
    return url.startswith((address, address.replace("http", "ws"), "data:", "blob:"))


def picture(page: Any, name: str) -> None:
    """Take pictures in both themes at the width of a desktop and a tablet.

    Fails if the page scrolls sideways, or if the header of a desktop wraps.
    """
    folder = os.environ.get("HIL_SCREENSHOTS")
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        for _ in range(2):
            page.wait_for_timeout(80)
            out = page.locator("html").evaluate("(html) => html.scrollWidth - html.clientWidth")
            assert out <= 0, f"{name} at a {size}'s width: {out} pixels stick out"
            rows_px = page.locator("header").evaluate("(header) => header.offsetHeight")
            assert size != "desktop" or rows_px < 60, f"{name}: the header has more than one row"
            if folder:
                theme = page.locator("html").get_attribute("data-theme")
                page.screenshot(path=f"{folder}/{name}-{size}-{theme}.png", full_page=True)
            page.click("#theme")
    page.set_viewport_size(dict(zip(("width", "height"), SIZES["desktop"], strict=True)))


def colours_in(page: Any, selector: str) -> int:
    """Return the number of different colours in a pane's picture."""
    return int(
        page.locator(selector).evaluate(
            """(canvas) => {
              const g = canvas.getContext("2d"), seen = new Set();
              const data = g.getImageData(0, 0, canvas.width, canvas.height).data;
              for (let k = 0; k < data.length; k += 4) seen.add((data[k] << 16) | (data[k + 1] << 8) | data[k + 2]);
              return seen.size;
            }"""
        )
    )


def altitude_m(page: Any) -> float:
    return float(page.inner_text("#numbers dd >> nth=0").split()[0])


def east_m(page: Any) -> float:
    return float(page.inner_text("#numbers dd >> nth=1").split()[0])


def start_and_watch(page: Any) -> None:
    page.select_option("#f-pace", "1")
    page.fill("#f-seed", "4")
    page.click("#start")
    page.wait_for_selector("#start:disabled")
    until(lambda: "Takeoff detected" in page.inner_text("#log"), page=page)
    pause(page)  # else a slow browser on a busy machine might draw nothing before the flight is over
    page.click("[data-stream='front/rgb']")
    until(lambda: colours_in(page, "[data-stream='front/rgb'] canvas") > 20, page=page)  # the run's own camera
    until(
        lambda: colours_in(page, "[data-stream='companion/mapper/map'] canvas") > 6, page=page
    )  # opened automatically
    page.select_option("#f-pace", "")
    page.click("#resume")
    until(lambda: page.inner_text("#status") in ("PASS", "FAIL", "ERROR"), page=page)
    assert page.inner_text("#status") == "PASS"
    log = page.inner_text("#log")
    assert "Takeoff detected" in log
    assert "Mission finished, landed" in log
    assert "seed 4" in page.inner_text("#headline")
    assert "not deterministic" not in page.inner_text("#headline")
    until(lambda: colours_in(page, "[data-stream='view/camera/rgb'] canvas") > 20, page=page)
    assert page.is_enabled("#start")
    picture(page, "watched")


def pause(page: Any) -> None:
    page.click("#pause")
    until(lambda: page.inner_text("#status").startswith("paused at tick"), page=page)


def fly_by_hand_and_break_a_sensor(page: Any) -> None:
    until(lambda: page.is_enabled("#start"), page=page)
    page.select_option("#f-pace", "1")  # time enough for a slow browser on a busy machine to follow
    page.click("#start")
    page.wait_for_selector("#start:disabled")  # until then the log shows the previous run
    until(lambda: "Takeoff detected" in page.inner_text("#log"), page=page)
    until(lambda: altitude_m(page) > 1.5, page=page)
    page.keyboard.down("Space")
    page.keyboard.down("KeyW")
    until(lambda: page.inner_text("#deadman") == "flying by hand", page=page)
    until(lambda: "mode position: MAV_RESULT_ACCEPTED" in page.inner_text("#log"), page=page)
    begun_m = altitude_m(page)
    until(lambda: altitude_m(page) > begun_m + 0.8, page=page)  # the mission would have stayed at 3 m or come down
    picture(page, "by-hand")
    page.keyboard.up("KeyW")
    page.keyboard.up("Space")
    until(lambda: page.inner_text("#deadman") == "sticks released", page=page)
    until(lambda: "dead-man switch released" in page.inner_text("#log"), page=page)
    held = """(_, held) => { window.pad = { connected: true, mapping: "standard", axes: [0, 0, 0, -0.7],
      buttons: Array.from({ length: 17 }, (_, k) => ({ pressed: held && k === 4 })) }; }"""
    page.locator("html").evaluate(held, True)  # a gamepad: L1 held, right stick forward
    until(lambda: page.inner_text("#deadman") == "flying by hand", page=page)
    page.locator("html").evaluate(held, False)
    until(lambda: page.inner_text("#deadman") == "sticks released", page=page)
    page.select_option("#fault-sensor", "gps")
    page.fill("#fault-for", "1")
    page.click("#inject-sensor")
    until(lambda: "gps: dropout began" in page.inner_text("#log"), page=page)
    break_links(page)
    pause(page)
    tick = int(page.inner_text("#status").split()[-1])
    page.click("#step")
    until(lambda: page.inner_text("#status").split()[-1] == str(tick + 1), page=page)
    page.click("#stop")
    until(lambda: page.inner_text("#status") == "ERROR", page=page)
    assert "not deterministic" in page.inner_text("#headline")


def break_links(page: Any) -> None:
    page.select_option("#fault-link", "autopilot")
    page.select_option("#fault-link-kind", "drop gps")
    page.fill("#fault-link-for", "0.5")
    page.click("#inject-link")
    until(lambda: "fault: link of the autopilot: drop 50 % of HIL_GPS for 0.5 s" in page.inner_text("#log"), page=page)
    page.select_option("#fault-link", "mapper")
    page.select_option("#fault-link-kind", "unplug")
    page.click("#inject-link")
    until(lambda: "companion mapper: unplug is over" in page.inner_text("#log"), page=page)
    until(lambda: page.inner_text("#log").count("companion_joined: mapper") == 2, page=page)


def look_back(page: Any) -> None:
    page.click("#tab-runs")
    rows = page.locator("#runs-table tbody tr[data-run]")
    until(lambda: rows.count() >= 2, page=page)
    passed = rows.filter(has_text="PASS").first
    passed.click()
    until(lambda: "PASS" in page.inner_text("#run-detail"), page=page)
    assert re.search(r"digest [0-9a-f]{64}", page.inner_text("#run-detail"))
    assert "landing speed" in page.inner_text("#run-detail")
    page.click("#replay")
    until(lambda: page.inner_text("#status") == "replay: PASS", page=page)
    slider = page.locator("#replay-time")
    heights = []
    for share in (0.0, 0.5, 1.0):
        slider.evaluate("(e, share) => { e.value = share * e.max; e.dispatchEvent(new Event('input')); }", share)
        heights.append(altitude_m(page))
    assert heights[0] < 0.5 < 2.0 < heights[1]
    assert heights[2] < 0.5
    until(lambda: colours_in(page, ".pane[data-stream*='front'] canvas") > 20, page=page)
    until(lambda: colours_in(page, ".pane[data-stream*='mapper'] canvas") > 6, page=page)
    picture(page, "replay")
    page.click("#replay-close")
    page.click("#tab-runs")
    until(lambda: rows.count() >= 2, page=page)
    for k in range(2):
        rows.nth(k).locator("input").check()
    page.click("#compare")
    until(lambda: "farthest apart" in page.inner_text("#run-detail"), page=page)
    assert "different digests" in page.inner_text("#run-detail")
    picture(page, "compared")


def test_a_session_at_the_bench(page: Any) -> None:
    """All steps are one test, since each uses the runs of the step before."""
    start_and_watch(page)
    fly_by_hand_and_break_a_sensor(page)
    look_back(page)


def inside(page: Any, selector: str) -> bool:
    """Return True if all of an element is in the part of the page that is seen."""
    box = page.locator(selector).bounding_box()
    size = page.viewport_size
    return (
        box is not None
        and box["x"] >= 0
        and box["y"] >= 0
        and box["x"] + box["width"] <= size["width"]
        and box["y"] + box["height"] <= size["height"]
    )


def middle(page: Any, selector: str, right: float = 0.0, up: float = 0.0) -> dict[str, float]:
    """Return a point of an element: from its middle, in halves of its size."""
    box = page.locator(selector).bounding_box()
    return {
        "x": box["x"] + 0.5 * box["width"] * (1.0 + right),
        "y": box["y"] + 0.5 * box["height"] * (1.0 - up),
    }


def test_own_missions_and_a_run_to_keep(page: Any, tmp_path: Path) -> None:
    """A mission is uploaded, one is drawn on the map and flown, and its run is downloaded."""
    page.set_viewport_size({"width": 1400, "height": 900})
    bad = {"name": "bad.plan", "mimeType": "text/plain", "buffer": b"{}"}
    page.set_input_files("#mission-file", bad)
    until(lambda: "bad.plan" in page.inner_text("#message"), page=page)
    hop = (tmp_path / "hop.waypoints").read_bytes()
    page.set_input_files("#mission-file", {"name": "mine.waypoints", "mimeType": "text/plain", "buffer": hop})
    until(lambda: page.input_value("#f-mission").endswith("/missions/mine.waypoints"), page=page)
    assert not page.is_visible("#message")
    page.click("#mission-draw")
    for right, up in ((0.1, 0.0), (0.1, 0.2), (-0.1, 0.2)):
        at = middle(page, "#view", right, up)
        page.mouse.click(at["x"], at["y"])
    assert page.inner_text("#draw-text").startswith("3 waypoints, ")
    page.click("#draw-undo")
    assert page.inner_text("#draw-text").startswith("2 waypoints, ")
    page.fill("#draw-height", "4")
    picture(page, "drawn")
    page.set_viewport_size({"width": 1400, "height": 900})
    page.click("#draw-use")
    until(lambda: "/missions/drawn-" in page.input_value("#f-mission"), page=page)
    page.select_option("#f-pace", "")
    page.check("#f-paused")
    page.click("#start")
    until(lambda: page.inner_text("#status").startswith("paused at tick"), page=page)
    page.click("#tab-runs")
    until(lambda: page.locator("#runs-table tbody tr[data-run]").count() == 1, page=page)
    assert "running" in page.inner_text("#runs-table")
    assert "ERROR" not in page.inner_text("#runs-table")
    page.click("#tab-live")
    page.click("#resume")
    until(lambda: page.inner_text("#status") in ("PASS", "FAIL", "ERROR"), page=page)
    assert page.inner_text("#status") == "PASS"
    page.set_input_files("#mission-file", bad)
    until(lambda: "bad.plan" in page.inner_text("#message"), page=page)
    page.locator("html").evaluate("() => window.sockets.at(-1).close()")  # as a slow page loses its connection
    until(lambda: page.inner_text("#status") == "no connection", page=page)
    until(lambda: page.inner_text("#status") == "PASS", page=page)
    assert "bad.plan" in page.inner_text("#message"), "an update of the run takes no other message away"
    assert page.inner_text("#log").count("Takeoff detected") == 1
    with page.expect_download() as download:
        page.click("#after-download")
    with zipfile.ZipFile(download.value.path()) as archive:
        (name,) = [name for name in archive.namelist() if name.endswith("/run.json")]
        run = json.loads(archive.read(name))
    assert "drawn-" in run["mission"]["file"]
    assert run["mission"]["reached"] == run["mission"]["waypoints"] == 3  # two, and the start
    page.click("#tab-runs")
    page.click("#runs-table tbody tr[data-run]")
    until(lambda: page.is_visible("#download"), page=page)


def test_the_form_follows_the_chosen_bench(page: Any) -> None:
    first = page.locator("#f-scene option").first
    assert first.inner_text() == "airfield (the bench's)"
    page.fill("#f-seed", "9")
    park = next(
        value
        for value in page.locator("#f-bench option").evaluate_all("(all) => all.map((one) => one.value)")
        if value.endswith("benches/dashboard.yaml")
    )
    page.select_option("#f-bench", park)
    until(lambda: first.inner_text() == "city_park (the bench's)", page=page)
    assert page.input_value("#f-seed") == ""


def test_lists_that_did_not_come_are_asked_for_again(browser: Any, address: str) -> None:
    """The first request fails on the way, the second on the server."""
    context = patient(browser.new_context())
    page = context.new_page()
    failures = [lambda route: route.abort(), lambda route: route.fulfill(status=500)]
    said: list[str] = []

    def answer(route: Any) -> None:
        said.append(page.inner_text("#message"))
        failures.pop(0)(route) if failures else route.continue_()

    page.route("**/api/choices", answer)
    open_dashboard(page, address)
    assert "did not come (Failed to fetch); asking again" in said[1]
    assert "did not come (status 500); asking again" in said[2]
    assert page.locator("#f-scene option").first.inner_text() == "airfield (the bench's)"
    assert not page.is_visible("#message")
    context.close()


def test_a_phone_flies_with_two_thumbs(browser: Any, address: str) -> None:
    viewport = dict(zip(("width", "height"), PHONE, strict=True))
    context = patient(browser.new_context(viewport=viewport, has_touch=True, is_mobile=True, device_scale_factor=2))
    page = context.new_page()
    open_dashboard(page, address)
    screenshot(page, "phone")
    for selector in ("#start-top", "#stick-left", "#stick-right", "#hold", "#view"):
        assert inside(page, selector), selector
    assert page.locator("html").evaluate("(html) => html.scrollWidth - html.clientWidth") == 0
    page.tap("#start-top")
    until(lambda: "Takeoff detected" in page.inner_text("#log"), page=page)
    for selector in ("#stop", "#stick-left", "#stick-right"):
        assert inside(page, selector), selector
    until(lambda: altitude_m(page) > 1.5, page=page)
    begun_m = altitude_m(page)
    touch = context.new_cdp_session(page)

    def put(kind: str, *points: dict[str, float]) -> None:
        touches = [point | {"id": k} for k, point in enumerate(points)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})

    left, right = middle(page, "#stick-left"), middle(page, "#stick-right")
    put("touchStart", left, right)
    put("touchMove", middle(page, "#stick-left", up=0.8), middle(page, "#stick-right", right=0.6))
    until(lambda: page.inner_text("#deadman") == "flying by hand", page=page)
    until(lambda: altitude_m(page) > begun_m + 2.0, page=page)  # the mission would have stayed at 3 m or come down
    screenshot(page, "phone-by-hand")
    assert "dead-man switch released" not in page.inner_text("#log")
    put("touchEnd")
    until(lambda: page.inner_text("#deadman") == "sticks released", page=page)
    until(lambda: "dead-man switch released" in page.inner_text("#log"), page=page)
    page.tap("#stop")
    until(lambda: page.inner_text("#status") == "ERROR", page=page)
    context.close()


def screenshot(page: Any, name: str) -> None:
    if folder := os.environ.get("HIL_SCREENSHOTS"):
        page.screenshot(path=f"{folder}/{name}.png")


@pytest.mark.slow
@pytest.mark.parametrize("address", [PAIR], indirect=True)
def test_a_run_of_two_vehicles(page: Any) -> None:
    page.select_option("#f-pace", "2")
    page.click("#start")
    until(lambda: page.is_visible("#vehicle"), page=page)
    assert page.locator("#vehicle option").all_inner_texts() == ["lead", "wing"]
    until(lambda: altitude_m(page) > 1.5, page=page)
    assert abs(east_m(page)) < 1.0
    page.click("[data-stream='front/rgb']")
    until(lambda: colours_in(page, "[data-stream='front/rgb'] canvas") > 20, page=page)
    page.select_option("#vehicle", "wing")
    until(lambda: abs(east_m(page) + 4.0) < 1.0, page=page)  # its place in the formation
    frames = int(page.get_attribute(".pane[data-stream='front/rgb']", "data-frames") or 0)
    until(lambda: int(page.get_attribute(".pane[data-stream='front/rgb']", "data-frames") or 0) > frames + 2, page=page)
    page.select_option("#fault-sensor", "baro")
    page.fill("#fault-for", "0.2")
    page.click("#inject-sensor")
    until(lambda: "wing: baro: dropout began" in page.inner_text("#log"), page=page)
    assert "lead: baro" not in page.inner_text("#log")
    picture(page, "two-vehicles")
    page.select_option("#f-pace", "")
    until(lambda: page.inner_text("#status") in ("PASS", "FAIL", "ERROR"), page=page)
    assert page.inner_text("#status") == "PASS"
    assert "not deterministic" in page.inner_text("#headline")
    page.click("#tab-runs")
    page.click("#runs-table tbody tr[data-run]")
    until(lambda: "min distance" in page.inner_text("#run-detail"), page=page)
    page.click("#replay")
    until(lambda: page.inner_text("#status") == "replay: PASS", page=page)
    assert abs(east_m(page)) < 0.1
    page.select_option("#vehicle", "wing")
    until(lambda: abs(east_m(page) + 4.0) < 0.1, page=page)
    page.locator("#replay-time").evaluate("(e) => { e.value = 0.5 * e.max; e.dispatchEvent(new Event('input')); }")
    until(lambda: colours_in(page, ".pane[data-stream='front/rgb'] canvas") > 20, page=page)
    assert altitude_m(page) > 2.0
    picture(page, "two-vehicles-replay")
