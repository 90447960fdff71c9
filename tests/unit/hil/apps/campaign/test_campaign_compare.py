"""Comparison of two campaigns: pairs, changes, McNemar's test and margins."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hil.apps.campaign.results.compare import compare_campaigns
from hil.cli.app import run_command_line
from signals.errors import ConfigError, RecordingError

Line = tuple[dict[str, Any], str, float | None]


def campaign(folder: Path, lines: list[Line], **settings: str) -> Path:
    """Write the results.jsonl of a campaign with one limit."""
    folder.mkdir()
    rows = []
    for number, (axes, status, margin) in enumerate(lines):
        limits = [{"name": "max_cross_track_m", "margin": margin}, {"name": "landed_tilt_deg", "margin": None}]
        texts = [f"{key}={json.dumps(value)}" for key, value in {**axes, **settings}.items()]
        case = f"{folder.name}{number}"
        flown = status != "UNFLOWN"
        status = status if flown else "PASS"
        rows.append({"case": case, "status": status, "flown": flown, "axes": axes, "limits": limits, "set": texts})
    (folder / "results.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder


def seeds(statuses: str, margins: list[float | None] | None = None, **axes: Any) -> list[Line]:
    """Return a case for each letter, with the seeds 0, 1, ..."""
    names = {"P": "PASS", "F": "FAIL", "E": "ERROR", "K": "FLAKE", "U": "UNFLOWN"}
    return [({"seed": n, **axes}, names[s], margins[n] if margins else 0.5) for n, s in enumerate(statuses)]


def test_the_exact_test_is_that_of_a_worked_example(tmp_path: Path) -> None:
    # M. Fay, R package exact2x2, example of mcnemar.exact: 21, 9, 2, 12 gives p = 0.06543
    a = campaign(tmp_path / "a", seeds("P" * 21 + "P" * 9 + "F" * 2 + "F" * 12))
    b = campaign(tmp_path / "b", seeds("P" * 21 + "F" * 9 + "P" * 2 + "F" * 12))
    found = compare_campaigns(a, b)
    assert found.discordant == (9, 2)
    assert found.p_value == pytest.approx(0.06543, abs=5e-6)
    assert compare_campaigns(b, a).p_value == pytest.approx(0.06543, abs=5e-6)
    assert compare_campaigns(a, a).p_value == 1.0


def test_an_error_is_worse_than_a_pass_and_in_no_test(tmp_path: Path) -> None:
    a = campaign(tmp_path / "a", seeds("PPFFEK"))
    b = campaign(tmp_path / "b", seeds("EKEPPP"))
    found = compare_campaigns(a, b)
    assert [change.second.status for change in found.worse] == ["ERROR", "FLAKE"]
    assert len(found.better) == 3
    assert found.discordant == (0, 1)
    assert found.exit_status == 1
    assert (found.not_judged, found.unanswered) == (1, "1 with ERROR or FLAKE in place of a verdict")
    assert compare_campaigns(a, a).not_judged == 2


def test_axes_without_a_common_value_are_left_out_and_named(tmp_path: Path) -> None:
    a = campaign(tmp_path / "a", seeds("PPP", binary="a.elf"), rig="mock")
    b = campaign(tmp_path / "b", seeds("PFP", binary="b.elf"), rig="px4")
    found = compare_campaigns(a, b)
    assert (found.pairs, found.left_out, len(found.worse)) == (3, ["binary"], 1)
    assert found.differences == {"binary": ('"a.elf"', '"b.elf"'), "rig": ('"mock"', '"px4"')}


def test_other_limits_are_told(tmp_path: Path) -> None:
    """A second campaign with wider limits in its bench file was no worse, without a word."""
    folders = [campaign(tmp_path / name, seeds("P")) for name in ("a", "b")]
    for folder, limits in zip(folders, ((1.0, None), (5.0, 30.0)), strict=True):
        row = json.loads((folder / "results.jsonl").read_text())
        for entry, limit in zip(row["limits"], limits, strict=True):
            entry["limit"] = limit
        (folder / "results.jsonl").write_text(json.dumps(row) + "\n")
    told = {"limit of max_cross_track_m": ("1", "5"), "limit of landed_tilt_deg": ("not judged", "30")}
    assert compare_campaigns(*folders).differences == told


def test_an_error_without_a_run_has_no_other_limits(tmp_path: Path) -> None:
    """A lost worker leaves no rows of limits, and each limit of its partner was told as one that it did not judge."""
    folders = [campaign(tmp_path / name, seeds(status)) for name, status in (("a", "P"), ("b", "E"))]
    for folder in folders:
        row = json.loads((folder / "results.jsonl").read_text())
        row["limits"] = [] if row["status"] == "ERROR" else [{**entry, "limit": 1.0} for entry in row["limits"]]
        (folder / "results.jsonl").write_text(json.dumps(row) + "\n")
    assert compare_campaigns(*folders).differences == {}
    assert compare_campaigns(*reversed(folders)).differences == {}


@pytest.mark.parametrize(
    ("ours", "theirs", "status", "partial", "said"),
    [
        ("PPFF", "PPFP", 0, 0, ""),
        ("PPPP", "PP", 1, 0, "2 without a partner"),
        ("PP", "PPPFF", 1, 0, "3 without a partner"),
        ("PFE", "PEE", 1, 0, "2 with ERROR or FLAKE in place of a verdict"),
        ("PF", "UU", 1, 1, "1 with ERROR or FLAKE in place of a verdict"),  # nobody flew: no case was worse
        ("PE", "PP", 0, 0, ""),  # better, whatever it was
        ("EEE", "KE", 1, 1, "1 without a partner, 2 with ERROR or FLAKE in place of a verdict"),  # nothing was judged
        ("PPPP", "PF", 1, 1, "2 without a partner"),
    ],
)
def test_cases_without_an_answer_are_no_success(
    tmp_path: Path,
    ours: str,
    theirs: str,
    status: int,
    partial: int,
    said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    a, b = campaign(tmp_path / "a", seeds(ours)), campaign(tmp_path / "b", seeds(theirs))
    assert run_command_line(["campaign", "compare", str(a), str(b)]) == status
    assert (f"not compared: {said}; so" in " ".join(capsys.readouterr().out.split())) is bool(said)
    assert run_command_line(["campaign", "compare", str(a), str(b), "--partial"]) == partial
    assert (f"not compared: {said}; accepted" in " ".join(capsys.readouterr().out.split())) is bool(said)
    assert compare_campaigns(a, b).alone == (max(0, len(ours) - len(theirs)), max(0, len(theirs) - len(ours)))


@pytest.mark.parametrize("stopped", ["a", "b"])
def test_what_a_campaign_that_was_stopped_did_not_fly_has_no_answer(
    tmp_path: Path, stopped: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two that were stopped at the same case had the same pairs, and no case became worse."""
    folders = [campaign(tmp_path / name, seeds("PF")) for name in ("a", "b")]
    for folder in folders:
        (folder / "campaign.json").write_text(json.dumps({"complete": folder.name != stopped}))
    command = ["campaign", "compare", *map(str, folders)]
    assert run_command_line(command) == 1
    assert f"not compared: those of its plan that {tmp_path / stopped} has not flown; so" in " ".join(
        capsys.readouterr().out.split()
    )
    assert run_command_line([*command, "--partial"]) == 0
    for whole in ({"complete": True}, {"complete": False, "stopped": "2 cases failed"}):  # by the rule of its file
        (tmp_path / stopped / "campaign.json").write_text(json.dumps(whole))
        assert run_command_line(command) == 0


def test_margins_are_compared_in_pairs(tmp_path: Path) -> None:
    a = campaign(tmp_path / "a", seeds("PPPP", [0.1, 0.2, 0.3, None]))
    b = campaign(tmp_path / "b", seeds("PPPP", [0.2, 0.2, 0.6, 0.4]))
    ((name, count, first, second, low, high),) = compare_campaigns(a, b).margin_rows()
    assert (name, count) == ("max_cross_track_m", 3)
    # differences 0.1, 0, 0.3: mean 0.13333, standard deviation 0.152753, over sqrt(3) 0.0881917, times 1.959964
    assert (first, second) == pytest.approx((0.2, 1.0 / 3.0))
    assert (low, high) == pytest.approx((0.133333 - 0.172853, 0.133333 + 0.172853), abs=1e-5)


def test_folders_that_do_not_fit_are_named(tmp_path: Path) -> None:
    a = campaign(tmp_path / "a", seeds("PP", scene="airfield"))
    other = campaign(tmp_path / "other", [({"seed": n + 5, "scene": "city_park"}, "PASS", 0.5) for n in range(2)])
    with pytest.raises(
        ConfigError, match=r"no axis with a value in common .*: nothing makes pairs \(without .*: scene, seed"
    ):
        compare_campaigns(a, other)
    with pytest.raises(ConfigError, match=r"nowhere/results.jsonl: does not exist \(give the folders"):
        compare_campaigns(a, tmp_path / "nowhere")
    lines = (a / "results.jsonl").read_text()
    for damage in ("{", "7", '{"case": 1}', "\xff", lines.splitlines()[0].replace("PASS", "GOOD")):
        (other / "results.jsonl").write_bytes((lines + damage).encode("latin-1"))
        with pytest.raises(RecordingError, match=r"results.jsonl:\d: damaged"):
            compare_campaigns(a, other)
    (other / "results.jsonl").write_text("")
    with pytest.raises(ConfigError, match=r"other/results.jsonl: holds no case"):
        compare_campaigns(a, other)


def test_the_command_exits_with_1_if_a_case_became_worse(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a = campaign(tmp_path / "a", seeds("PPF" + "P" * 30))
    b = campaign(tmp_path / "b", seeds("PFP" + "F" * 30))
    out = tmp_path / "difference.json"
    assert run_command_line(["campaign", "compare", str(a), str(b), "--json", str(out)]) == 1
    printed = capsys.readouterr().out
    assert "PASS to FAIL: 31, FAIL to PASS: 1; exact McNemar test p = " in printed
    assert "PASS -> FAIL  a1 -> b1  seed=1" in printed
    assert "and 11 more" in printed
    data = json.loads(out.read_text())
    assert (data["pairs"], len(data["worse"]), len(data["better"]), data["exit_status"]) == (33, 31, 1, 1)
    again = campaign(tmp_path / "again", seeds("PPF" + "P" * 30))
    assert run_command_line(["campaign", "compare", str(a), str(again)]) == 0
    assert run_command_line(["campaign", "compare", str(a), f"{a}/../a"]) == 2
    assert "is named twice: no case can be worse than itself" in capsys.readouterr().err
    assert run_command_line(["campaign", "compare", str(a), str(tmp_path / "none")]) == 2
