"""Campaigns on the dashboard: the list, damaged files, and the policy of their pages."""

from __future__ import annotations

import asyncio
import json
import os
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from hil.apps.dash.past.campaigns import Campaigns
from hil.apps.dash.server.app import Dashboard
from hil.run.report.row_search import SCRIPT_SOURCE

COUNTS = {"cases": 3, "pass": 2, "fail": 1, "error": 0, "flake": 0, "pass_rate": [0.2, 0.67, 0.9]}
HOSTILE = [
    "",
    "[]",
    '{"cases": 1}',
    json.dumps(COUNTS | {"pass": "2"}),
    json.dumps(COUNTS | {"pass_rate": [1.0]}),
    json.dumps(COUNTS | {"doing": {"phase": 3}}),
    json.dumps(COUNTS | {"stopped": "\ud800"}),
    json.dumps(COUNTS | {"pass_rate": [0.1, float("nan"), 1]}),
]


def directive(text: str) -> tuple[str, str]:
    name, _, sources = text.partition(" ")
    return name, sources


def write(folder: Path, name: str, content: str, age_s: int = 0) -> Path:
    path = folder / "campaigns" / name / "campaign.json"
    path.parent.mkdir(parents=True)
    path.write_text(content)
    os.utime(path, (path.stat().st_mtime - age_s,) * 2)
    return path.parent


class Reply(NamedTuple):
    status: int
    headers: dict[str, str]
    text: str

    def json(self) -> Any:
        return json.loads(self.text)


def get(folder: Path, path: str, *, token: str | None = None, query: str = "", **headers: str) -> Reply:
    """Ask the dashboard whose runs are in `folder`/runs."""
    headers.setdefault("host", "127.0.0.1")
    scope = {
        "type": "http",
        "asgi": {"spec_version": "2.4"},
        "method": "GET",
        "path": path,
        "root_path": "",
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
    }
    said: list[Any] = []

    async def send(message: Any) -> None:
        said.append(message)

    async def receive() -> Any:
        return {"type": "http.disconnect"}

    asyncio.run(Dashboard(config=None, runs=folder / "runs").application(token)(scope, receive, send))
    sent = {name.decode(): value.decode() for name, value in said[0]["headers"]}
    return Reply(said[0]["status"], sent, b"".join(message.get("body", b"") for message in said[1:]).decode())


def test_campaigns_are_listed_with_their_counts_the_newest_first(tmp_path: Path) -> None:
    doing = {"phase": "flights", "done": 3, "total": 9}
    write(tmp_path, "going_on", json.dumps(COUNTS | {"complete": False, "doing": doing}), age_s=100)
    write(tmp_path, "done", json.dumps(COUNTS | {"complete": True, "doing": None, "program": "ab"}))
    (tmp_path / "campaigns" / "no_campaign").mkdir()
    done, going_on = get(tmp_path, "/api/campaigns").json()
    assert (done["name"], done["complete"], done["report"], done["pass"]) == ("done", True, False, 2)
    assert going_on["doing"] == doing
    assert 100 <= going_on["age_s"] < 200
    assert get(tmp_path / "nowhere", "/api/campaigns").json() == []


@pytest.mark.parametrize("content", HOSTILE, ids=lambda content: content[:40])
def test_a_damaged_file_hides_no_other_campaign(tmp_path: Path, content: str) -> None:
    write(tmp_path, "good", json.dumps(COUNTS), age_s=5)
    write(tmp_path, "hostile", content)
    hostile, good = get(tmp_path, "/api/campaigns").json()
    assert (good["name"], good["broken"]) == ("good", None)
    assert "hostile/campaign.json: damaged" in hostile["broken"]


def test_files_of_a_campaign_and_no_others_are_served(tmp_path: Path) -> None:
    folder = write(tmp_path, "wind", json.dumps(COUNTS))
    (tmp_path / "secret.json").write_text("{}")
    (folder / "report.html").write_text("<p>all</p>")
    case = folder / "cases" / "ab12"
    case.mkdir(parents=True)
    (case / "report.html").write_text("<p>one</p>")
    (case / "run.mcap").write_text("")
    (folder / "campaign.sqlite").write_text("")
    (folder / "link.json").symlink_to(tmp_path / "secret.json")
    page, one = (get(tmp_path, f"/campaigns/wind/{path}") for path in ("report.html", "cases/ab12/report.html"))
    assert (page.text, one.text) == ("<p>all</p>", "<p>one</p>")
    for path in ("campaign.sqlite", "link.json", "cases/ab12/run.mcap", "../../secret.json", "cases"):
        assert get(tmp_path, f"/campaigns/wind/{path}").status == 404, path
    policies = [dict(map(directive, reply.headers["content-security-policy"].split("; "))) for reply in (page, one)]
    assert policies[0]["script-src"] == SCRIPT_SOURCE  # the page's own search and nothing else
    assert "script-src" not in policies[1]
    assert {policy["default-src"] for policy in policies} == {"'none'"}


def test_a_token_is_needed_for_campaigns_too(tmp_path: Path) -> None:
    folder = write(tmp_path, "wind", json.dumps(COUNTS))
    (folder / "report.html").write_text("<p>all</p>")
    for path in ("/api/campaigns", "/campaigns/wind/report.html"):
        assert get(tmp_path, path, token="secret").status == 401
        assert get(tmp_path, path, token="secret", query="token=secret").status == 303  # with the cookie
        assert get(tmp_path, path, token="secret", cookie="hil_dash=secret").status == 200
        assert (
            get(tmp_path, path, token="secret", cookie="hil_dash=secret", origin="http://other.example").status == 403
        )


def test_a_link_is_no_campaign(tmp_path: Path) -> None:
    folder = write(tmp_path, "wind", json.dumps(COUNTS))
    (folder.parent / "latest").symlink_to(folder)
    listed: list[dict[str, Any]] = Campaigns(folder.parent).listed()
    assert [found["name"] for found in listed] == ["wind"]
