"""Result of one flight for a test: verdict, measurements by name, and the health of its link."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from hil.run_files import RUN_JSON_NAME, TLOG_NAME

HEALTH = {
    "crc_errors": "MAVLink frames with a wrong checksum",
    "garbage": "bytes that belong to no frame",
    "lost_frames": "frames of the autopilot that never arrived",
    "late": "samples or replies that came too late",
    "estimator_reset": "resets of the autopilot's estimator in the air",
    "unflown": "a PASS of a vehicle that never left its start",
    "fail": "a FAIL whose verdict the test did not read, by run.passed, run.status or run.reasons",
    "crash": "a FAIL with a crash whose verdict the test did not read",
    "error": "an ERROR: the bench could not finish the flight",
}
_GROUND_STATION = 255


class BenchError(AssertionError):
    """A flight ended as ERROR. `run` holds the results up to that point."""

    def __init__(self, run: Run) -> None:
        self.run = run
        error = run.json.get("error") or {}
        super().__init__(f"{error.get('type')}: {error.get('message')}\nthe run is in {run.out}")


@dataclass(frozen=True, repr=False)
class Run:
    """One flight. `json` is the content of run.json; each measurement of the verdict is also an attribute.

    A flight of several vehicles has the measurements between them, and one `Run` for each vehicle in `vehicles`.
    """

    json: dict[str, Any]
    out: Path
    verdict_reads: list[str] = field(default_factory=list, compare=False)  # what the test has asked of the verdict

    def __repr__(self) -> str:
        return f"<Run {self.json['status']}, seed {self.seed}, digest {self.digest[:8]}, {self.out}>"

    @property
    def status(self) -> str:
        """PASS, FAIL or ERROR."""
        self.verdict_reads.append("status")
        return str(self.json["status"])

    @property
    def passed(self) -> bool:
        """True if the vehicle met every limit of its bench."""
        return self.status == "PASS"

    @property
    def reasons(self) -> list[str]:
        """The limits that were not met, in words; empty for a PASS."""
        self.verdict_reads.append("reasons")
        return list(self.json["verdict"]["reasons"])

    @property
    def digest(self) -> str:
        """Digest of the whole flight: the same in every run of the same configuration."""
        return str(self.json["digest"])

    @property
    def seed(self) -> int:
        """Seed of all noise."""
        return int(self.json["seed"])

    @property
    def measurements(self) -> dict[str, float | None]:
        """Measurements by name; None if the flight did not yield one."""
        return {row["name"]: row["value"] for row in self.json["verdict"]["rows"]}

    @cached_property
    def vehicles(self) -> dict[str, Run]:
        """The flights of the vehicles by name; empty for a bench without the section `vehicles`."""
        folders = {name: self.out / vehicle["folder"] for name, vehicle in self.json.get("vehicles", {}).items()}
        return {name: Run(json.loads((out / RUN_JSON_NAME).read_text()), out) for name, out in folders.items()}

    def __getattr__(self, name: str) -> Any:
        """Return a measurement or an entry of run.json's mission, such as `run.max_cross_track_m` or `run.completed`.

        Raises AttributeError for an unknown name, AssertionError if the flight did not yield it.
        """
        if name.startswith("__") or name in ("json", "out", "verdict_reads"):
            raise AttributeError(name)
        values = self.measurements | self.json["mission"]
        if name not in values:
            raise AttributeError(f"a run has no {name!r}; it has: {', '.join(sorted(values))}")
        if values[name] is None:
            why = "; ".join(self.json["verdict"]["reasons"]) or "the flight never reached that part"
            raise AssertionError(f"{name} was never measured: {why}")
        return values[name]


def unread_reasons(run: Run) -> list[str]:
    """Return the reasons of a FAIL whose verdict the test did not read, of the run or of the vehicle concerned.

    Measurements are no verdict: a flight that stops at its second waypoint has a small cross-track error.
    """
    if run.json["status"] != "FAIL" or run.verdict_reads:
        return []
    known = tuple(f"{name}: " for name, vehicle in run.vehicles.items() if vehicle.verdict_reads)
    return [reason for reason in run.json["verdict"]["reasons"] if not reason.startswith(known)]


def verdict_health(run: Run) -> dict[str, int]:
    """Return the number of occurrences of the items of `HEALTH` that concern the verdict of a flight."""
    unread = unread_reasons(run)
    crashes = sum("crashed: " in reason for reason in unread)
    return {
        "unflown": int(run.json["status"] == "PASS" and "unflown" in run.json),  # of several: if no vehicle flew
        "fail": int(bool(unread) and not crashes),
        "crash": crashes,
        "error": int(run.json["status"] == "ERROR"),
    }


def health(run: Run) -> dict[str, int]:
    """Return the number of occurrences of each item of `HEALTH` in a flight, of all vehicles together."""
    own = verdict_health(run)
    if "vehicles" in run.json:
        found = [health(vehicle) for vehicle in run.vehicles.values()]
        return {name: sum(counts[name] for counts in found) for name in HEALTH} | own
    link = run.json["autopilot"].get("link") or {}
    timing = run.json.get("timing") or {}
    return {
        "crc_errors": link.get("bad_crc", 0),
        "garbage": link.get("garbage_bytes", 0),
        "lost_frames": link.get("lost_frames", 0),
        "late": run.json["autopilot"]["late"] + timing.get("paced_ticks_late", 0),
        "estimator_reset": _estimator_resets(run.out / TLOG_NAME),
        **own,
    }


_RESET_WORDS = re.compile(r"\b(e?kf\d?|estimator)\b.*\breset|\breset.*\b(e?kf\d?|estimator)\b", re.IGNORECASE)


def _estimator_resets(tlog: Path) -> int:
    """Count estimator resets while armed, by ODOMETRY's reset counter and by STATUSTEXT messages; 0 without a log.

    Resets while disarmed are normal: the estimator is still finding its heading.
    """
    if not tlog.is_file():
        return 0
    from firmware_bridge.codecs.mavlink_frame import FrameParser
    from firmware_bridge.codecs.messages import MSGID, unpack

    heartbeat, odometry, text = MSGID["HEARTBEAT"], MSGID["ODOMETRY"], MSGID["STATUSTEXT"]
    wanted = (heartbeat, odometry, text)
    resets, armed, counter = 0, False, None
    # Each frame of a tlog follows eight bytes of time; the parser skips them as it skips any noise.
    for frame in FrameParser().feed(tlog.read_bytes()):
        if frame.msgid not in wanted or frame.sysid == _GROUND_STATION:
            continue
        message = unpack(frame)
        if frame.msgid == heartbeat:
            armed = bool(message.base_mode & 128)
        elif frame.msgid == text:
            resets += armed and _RESET_WORDS.search(message.text) is not None
        else:
            resets += armed and counter is not None and message.reset_counter != counter
            counter = message.reset_counter
    return resets
