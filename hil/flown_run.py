"""One flight as a test sees it: its verdict and measurements by name, and whether its link was clean."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HEALTH = {
    "crc_errors": "MAVLink frames with a wrong checksum",
    "garbage": "bytes that belong to no frame",
    "lost_frames": "frames of the autopilot that never arrived",
    "late": "samples or answers that came too late",
    "estimator_reset": "resets of the autopilot's estimator in the air",
    "error": "an ERROR: the bench could not finish the flight",
}
_GROUND_STATION = 255


class BenchError(AssertionError):
    """A flight ended as ERROR. `run` is what there is of it."""

    def __init__(self, run: Run) -> None:
        self.run = run
        error = run.json.get("error") or {}
        super().__init__(f"{error.get('type')}: {error.get('message')}\nthe run is in {run.out}")


@dataclass(frozen=True, repr=False)
class Run:
    """One flight. `json` is what run.json holds; every measurement of the verdict can be asked for by its name."""

    json: dict[str, Any]
    out: Path

    def __repr__(self) -> str:
        return f"<Run {self.status}, seed {self.seed}, digest {self.digest[:8]}, {self.out}>"

    @property
    def status(self) -> str:
        """PASS, FAIL or ERROR."""
        return str(self.json["status"])

    @property
    def passed(self) -> bool:
        """Whether the vehicle met every limit of its bench."""
        return self.status == "PASS"

    @property
    def reasons(self) -> list[str]:
        """Why not."""
        return list(self.json["verdict"]["reasons"])

    @property
    def digest(self) -> str:
        """Of everything that happened: the same in every run of the same configuration."""
        return str(self.json["digest"])

    @property
    def seed(self) -> int:
        """Of all noise."""
        return int(self.json["seed"])

    @property
    def measurements(self) -> dict[str, float | None]:
        """Every measurement by name; None where the flight did not yield it."""
        return {row["name"]: row["value"] for row in self.json["verdict"]["rows"]}

    def __getattr__(self, name: str) -> Any:
        """`run.max_cross_track_m`, `run.completed`: a measurement, or what run.json says of the mission."""
        if name.startswith("__") or name in ("json", "out"):
            raise AttributeError(name)
        values = self.measurements | self.json["mission"]
        if name not in values:
            raise AttributeError(f"a run has no {name!r}; it has: {', '.join(sorted(values))}")
        if values[name] is None:
            why = "; ".join(self.reasons) or "nothing of the flight called for it"
            raise AssertionError(f"{name} was never measured: {why}")
        return values[name]


def health(run: Run) -> dict[str, int]:
    """How often each of `HEALTH` happened in a flight."""
    link = run.json["autopilot"].get("link") or {}
    timing = run.json.get("timing") or {}
    return {
        "crc_errors": link.get("bad_crc", 0),
        "garbage": link.get("garbage_bytes", 0),
        "lost_frames": link.get("lost_frames", 0),
        "late": run.json["autopilot"]["late"] + timing.get("paced_ticks_late", 0),
        "estimator_reset": _estimator_resets(run.out / "flight.tlog"),
        "error": int(run.status == "ERROR"),
    }


_RESET_WORDS = re.compile(r"\b(e?kf\d?|estimator)\b.*\breset|\breset.*\b(e?kf\d?|estimator)\b", re.IGNORECASE)


def _estimator_resets(tlog: Path) -> int:
    """Resets while armed: ODOMETRY's counter, and what the autopilot says of it in words. 0 without a log.

    While disarmed an estimator may find its heading as often as it likes.
    """
    if not tlog.is_file():
        return 0
    from firmware_bridge.codecs.mavlink_frame import FrameParser
    from firmware_bridge.codecs.messages import MSGID, unpack

    heartbeat, odometry, text = MSGID["HEARTBEAT"], MSGID["ODOMETRY"], MSGID["STATUSTEXT"]
    wanted = (heartbeat, odometry, text)
    resets, armed, counter = 0, False, None
    # Eight bytes of time stand before each frame; the parser passes over them as over any noise.
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
