"""The dashboard and a run of several vehicles: whose values a page gets, and whom its commands reach."""

from __future__ import annotations

import asyncio
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from hil.apps.dash.part import DashboardPart
from hil.apps.dash.past.past_runs import PastRuns
from hil.apps.dash.server.hub import Hub, Page
from hil.apps.dash.views.preview_sensors import PreviewSensors
from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from hil.run.feed.payloads import array_payload, payload_array
from tests.worlds.dashboard_page import PageThread

BENCH = """
rig: mock
mission: rigs/missions/square.waypoints
duration_s: 3
autopilot: {transport: loopback}
record: {report: false, tlog: false}
vehicles: {lead: {}, wing: {}}
formation: {spacing_m: 4}
"""


def fly(folder: Path, page: PageThread | None = None) -> RunResult:
    (folder / "bench.yaml").write_text(BENCH)
    bench = load_bench(folder / "bench.yaml")
    if page is None:
        return run_bench(bench, folder / "alone", quiet=True)
    live = page.live(paused=True)
    try:
        return run_bench(bench, folder / "run", quiet=True, more=lambda name: [DashboardPart(live, name)])
    finally:
        live.close()
        page.join()


def test_commands_reach_their_vehicle_and_the_wind_all(tmp_path: Path) -> None:
    asked: list[str] = []

    def script(page: PageThread, state: dict[str, Any]) -> None:
        if len(asked) < 4 and state["tick"] == min(len(asked), 2):
            asked.append(str(state["tick"]))
            if len(asked) < 3:  # twice a step, each of both vehicles
                page.say(kind="step")
            elif len(asked) == 3:
                fault = {"rotor": 1, "kind": "efficiency", "factor": 0.9}
                page.say(kind="inject", vehicle="wing", fault=fault)
                page.say(kind="inject", vehicle="wing", fault={"rotor": 9, "kind": "stuck"})
                page.say(kind="wind", vehicle="wing", velocity_W_mps=[0, 1, 0])
                page.say(kind="resume")

    page = PageThread([], script)
    result = fly(tmp_path, page)
    assert result.run["error"] is None
    begin, end = page.others
    assert list(begin["vehicles"]) == ["lead", "wing"]
    assert begin["out"] == str(result.out.resolve())
    assert end["run"]["vehicles"].keys() == {"lead", "wing"}
    assert set(page.states[-1]["vehicles"]) == {"lead", "wing"}  # the last state is of all
    first = page.states[2]
    assert set(first["vehicles"]) == {"lead"}
    assert np.allclose(first["places"]["wing"][0][:2], (-4.0, 4.0), atol=0.1)
    texts = [text for state in page.states for _, _, text in state["events"]]
    assert any(text.startswith("wing: inject: ") for text in texts)  # there is no rotor 9
    by_hand = {
        name: [row["what"] for row in json.loads((result.out / name / "run.json").read_text()).get("by_hand", ())]
        for name in ("lead", "wing")
    }
    assert any("rotor 1" in text for text in by_hand["wing"])
    assert not any("rotor 1" in text for text in by_hand["lead"])
    assert all(any("wind by hand" in text for text in texts) for texts in by_hand.values())
    assert result.run["deterministic"] is False


def test_a_page_changes_no_vehicle_and_a_past_run_shows_each(tmp_path: Path) -> None:
    alone = fly(tmp_path)
    watched = fly(tmp_path, PageThread([], lambda page, _: page.say(kind="resume")))
    assert watched.run["digest"] == alone.run["digest"]
    past = PastRuns(tmp_path)
    track = past.track("run", "wing")
    assert (track["vehicle"], track["vehicles"], list(track["others"])) == ("wing", ["lead", "wing"], ["lead"])
    assert np.allclose(track["p"][0][:2], (-4.0, 4.0), atol=1e-6)
    assert len(track["others"]["lead"]["p"]) == len(track["t"]) > 50
    assert past.track("run")["vehicle"] == past.track("run", "third")["vehicle"] == "lead"
    assert (past.summary("run", "wing") or {})["autopilot"]["kind"] == "mock"
    assert past.summary("run", "third") is None
    assert past.moments.at("run", 10**9, [], "third") is None


def test_a_preview_shows_the_other_vehicles(tmp_path: Path) -> None:
    (tmp_path / "bench.yaml").write_text(BENCH)
    previews, level = PreviewSensors(tmp_path / "bench.yaml"), (1.0, 0.0, 0.0, 0.0)

    def nearest_m(ahead_m: float, t_ns: int) -> float:
        places = {"lead": ((0.0, 0.0, 5.0), level), "wing": ((ahead_m, 0.0, 5.0), level)}
        (payload,) = previews.render(["view/camera/depth"], places, t_ns, "lead").values()
        return float(payload_array(payload).min())

    assert 1.3 < nearest_m(2.0, 4_000_000) < 2.0
    assert 3.3 < nearest_m(4.0, 8_000_000) < 4.0
    assert nearest_m(-4.0, 12_000_000) > 4.5  # behind: only the ground, from 5 m up


def about() -> dict[str, Any]:
    own = {"home": [0, 0, 0], "rotor_positions": [[1, 1, 0]], "rig": "mock"}
    vehicles = {name: own | {"mission": name} for name in ("lead", "wing")}
    return {"kind": "begin", "out": "", "lockstep": True, "vehicles": vehicles}


def state(k: int) -> dict[str, Any]:
    frame = {"t_ns": k, "p": (0.0,) * 3, "q": (1.0, 0.0, 0.0, 0.0)} | array_payload(np.zeros((8, 8), np.float32))
    return {
        "kind": "state",
        "tick": k,
        "t_ns": k,
        "vehicles": {name: {"phase": f"of {name}", "slow": {"links": [name]}} for name in ("lead", "wing")},
        "places": {"lead": None, "wing": None},
        "frames": {f"{name}/front/depth": frame for name in ("lead", "wing")},
    }


def test_each_page_gets_the_vehicle_that_it_chose() -> None:
    async def scenario() -> None:
        hub, heads = Hub(), {"lead": [], "wing": []}  # type: ignore[var-annotated]
        said: list[dict[str, Any]] = []
        hub._send_to_run = said.append  # type: ignore[method-assign]
        hub._run_link = object()  # type: ignore[assignment]

        def page_of(name: str) -> Page:
            async def take(data: bytes) -> None:
                (length,) = struct.unpack_from("<I", data)
                heads[name].append(json.loads(data[4 : 4 + length]))

            return Page(take)

        lead, wing = page_of("lead"), page_of("wing")
        hub.pages |= {lead, wing}
        await hub._handle(about())
        for page, name in ((lead, ""), (wing, "wing")):
            hub.receive(page, {"kind": "streams", "streams": ["front/depth"], "vehicle": name})
            hub.receive(page, {"kind": "next"})
        await asyncio.sleep(0)
        await hub._handle(state(1))
        for page in (lead, wing):
            hub.receive(page, {"kind": "next"})
            while page.sender is not None:
                await asyncio.sleep(0)
        for name, got in heads.items():
            assert next(head for head in got if "about" in head)["about"]["mission"] == name
            assert got[-1]["state"]["phase"] == f"of {name}"
            assert [head["slow"] for head in got if "slow" in head][-1] == {"links": [name]}
            assert [frame["stream"] for head in got for frame in head["frames"]] == ["front/depth"]
        assert said[-1] == {
            "kind": "next",
            "streams": ["lead/front/depth", "wing/front/depth"],
            "vehicles": ["lead", "wing"],
        }
        fault = {"kind": "inject", "fault": {}}
        hub._run_link = None
        said.clear()
        hub.receive(wing, fault)
        hub.receive(wing, {"kind": "sticks", "held": True})
        hub.receive(wing, {"kind": "streams", "streams": [], "vehicle": "lead"})
        assert [(m["kind"], m["vehicle"]) for m in said] == [("inject", "wing"), ("sticks", "wing"), ("sticks", "wing")]
        assert said[-1]["held"] is False

    asyncio.run(scenario())
