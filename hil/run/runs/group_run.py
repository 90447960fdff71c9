"""A run with several vehicles: each is a run of its own in OUT/NAME, and all share the world and the recording.

OUT holds run.mcap with the topics of all vehicles, run.json and report.html about all of them, and bench.yaml, from
which the run can be repeated.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from hil.config import Bench, save_bench
from hil.config.formation import formation_offsets
from hil.config.saved import scene_of_vehicles
from hil.run.part import Part
from hil.run.parts.catalog import parts_of
from hil.run.recorder.mcap.mcap_file import SafeFile, VehicleTopics
from hil.run.recorder.mcap.mcap_sink import McapRecording
from hil.run.report.group_report import write_group_report
from hil.run.runs.failure import Failure
from hil.run.runs.fleet import Fleet
from hil.run.runs.run_file import RunFile
from hil.run.runs.tick_loop import Flight, VehicleFailed
from hil.run.runs.vehicle_run import RunResult, Shared, VehicleRun
from hil.run.verdict.group import GroupMeasurement, contact_text
from hil.run.verdict.verdict import Row
from hil.run_files import MCAP_NAME
from signals.errors import file_errors
from signals.samples import TruthState
from signals.time import NS_PER_S
from sim.frame.source import SharedFrames
from sim.physics.vehicle_group import VehicleContact


class GroupRun:
    """One run of several vehicles, from their parts to the group's run.json."""

    def __init__(self, bench: Bench, out: Path, more: Callable[[str], Sequence[Part]], *, quiet: bool) -> None:
        """`more` makes the parts that the caller adds to a vehicle. Raises ConfigError for settings of parts."""
        self._bench, self._out, self._quiet = bench, out, quiet
        self._file = RunFile(out)
        self._failure = Failure(out)
        self._parts = {name: parts_of(vehicle, more(name)) for name, vehicle in bench.vehicles.items()}
        self._recording: McapRecording | None = None
        self._frames: SharedFrames | None = None  # made for the first sensor that needs the geometry
        self._runs: dict[str, VehicleRun] = {}
        self._fleet: Fleet | None = None
        self._results: dict[str, RunResult] = {}
        self._lost_with: dict[str, Sequence[str]] = {}  # causes of a FAIL when each lost vehicle was lost
        self._began_s = time.monotonic()
        formation = bench.config.formation
        offsets = None if formation is None else formation_offsets(formation, list(bench.vehicles))
        self._measured = GroupMeasurement(
            list(bench.vehicles),
            offsets_W_m=offsets,
            formed_m=None if formation is None else formation.max_error_m,
            flown_share=self._flown_share,
        )

    def result(self) -> RunResult:
        """Fly, judge, and write run.json and the report of every vehicle and of all together."""
        self._file.begin(self._summary(None))
        self._failure.guard(self._prepare_and_fly)
        self._results = {name: run.finish() for name, run in self._runs.items()}
        if (recording := self._recording) is not None:
            result = {"status": self._status(), "digest": self._digest()}
            self._failure.guard(lambda: recording.close(self._ticks(), result))
        if self._bench.config.record.report and self._ticks():
            tracks = {name: run.context.recorder.track.arrays() for name, run in self._runs.items()}
            self._failure.guard(lambda: write_group_report(self._out, self._summary(self._failure.error), tracks))
        run = self._file.end(self._summary(self._failure.error))
        for vehicle in self._runs.values():
            for part in vehicle.context.parts:
                part.after_group(run)
        refused = None if run["sim_s"] > 0.0 else self._failure.config_error
        return RunResult(run["status"], run, self._out, refused)

    def _prepare_and_fly(self) -> None:
        try:
            self._file.reserve()
            self._open_recording()
        except (Exception, KeyboardInterrupt) as error:
            for run in self._runs.values():
                run.failure.note(error)
            raise
        downwash = self._bench.config.group.downwash
        self._fleet = Fleet(self._runs, quiet=self._quiet, downwash=downwash, place=self._place, on_tick=self._measure)
        try:
            self._fleet.run()
        except VehicleFailed as failed:
            self._failure.note(failed.__cause__ or failed, f"{failed.name}: ")

    def _open_recording(self) -> None:
        """Save the bench, open the recording, and make the runs of the vehicles."""
        bench, out = self._bench, self._out
        with file_errors(out, "the bench cannot be saved here"):
            saved = save_bench(bench, out)
        if bench.config.record.mcap:
            metadata = {"scene": bench.scene.name, "seed": str(bench.config.seed), "vehicles": " ".join(bench.vehicles)}
            self._recording = McapRecording(
                SafeFile(out / MCAP_NAME),
                tick_ns=self._tick_ns,
                metadata=metadata,
                attachments={saved.name: saved.read_bytes()},
            )
        scene = scene_of_vehicles(bench, saved)
        for name, vehicle in bench.vehicles.items():
            mcap = False if self._recording is None else VehicleTopics(self._recording.mcap, name)
            shared = Shared(mcap, partial(self._frames_of, name), scene)
            self._runs[name] = VehicleRun(vehicle, out / name, self._parts[name], quiet=self._quiet, shared=shared)
            self._results[name] = self._runs[name].mark_unfinished()
        self._file.begin(self._summary(None))

    def _frames_of(self, name: str) -> SharedFrames:
        """Return the geometry for the sensors of one vehicle: the scene and the other vehicles."""
        if self._frames is None:
            self._frames = SharedFrames(self._bench.world)
        return self._frames.seen_by(name)

    @property
    def _tick_ns(self) -> int:
        return next(iter(self._bench.vehicles.values())).config.tick_ns

    @property
    def _flights(self) -> Mapping[str, Flight]:
        return {} if self._fleet is None else self._fleet.flights

    def _place(self, truths: Mapping[str, TruthState]) -> None:
        """Give the vehicles' places at this tick to the cameras, LiDARs and radars."""
        if self._frames is not None:
            for name, truth in truths.items():
                self._frames.place(name, truth)

    def _measure(self, truths: Sequence[TruthState], contacts: Sequence[VehicleContact]) -> None:
        for name, flight in self._flights.items():
            if flight.lost and name not in self._lost_with:
                self._lost_with[name] = self._runs[name].causes()
        if truths:
            self._measured.add(truths, [flight.over for flight in self._flights.values()])
        self._record_contacts(contacts)

    def _record_contacts(self, contacts: Sequence[VehicleContact]) -> None:
        for contact in contacts:
            self._measured.contacts.append(contact)
            for name in (contact.a, contact.b):
                if not self._flights[name].over:
                    self._runs[name].context.event("error", contact_text(contact))

    def _flown_share(self) -> float:
        """Return the greatest share of its waypoints that a vehicle with a mission has reached, 1 if one is lost."""
        share = 0.0
        for flight in self._flights.values():
            _, reached, waypoints = flight.run.status()
            share = max(share, 1.0 if flight.lost else reached / max(waypoints, 1))
        return share

    def _ticks(self) -> int:
        return max((run.context.ticks for run in self._runs.values()), default=0)

    def _digest(self) -> str:
        """Return the digest of the run: the hash of the vehicles' names and digests, in order."""
        text = "".join(f"{name} {result.run['digest']}\n" for name, result in self._results.items())
        return hashlib.blake2b(text.encode(), digest_size=32).hexdigest()

    def _verdict(self) -> tuple[list[Row], list[str]]:
        """Return the measurements of the group, and the reasons for a FAIL of all vehicles but expendable ones.

        If every vehicle is lost, none was expendable. A vehicle that had crashed before it was lost is a FAIL as well.
        """
        formation = self._bench.config.formation
        lost = self._lost_with
        rows, reasons = self._measured.verdict(
            self._bench.config.group, None if formation is None else formation.max_error_m, lost
        )
        for name, result in self._results.items():
            expendable = name in lost and len(lost) < len(self._results)
            why = self._lost_with[name] if expendable else result.run["verdict"]["reasons"]
            reasons += [f"{name}: {reason}" for reason in why]
        return rows, reasons

    def _status(self) -> str:
        broken = any(result.status == "ERROR" for result in self._results.values())
        if self._failure.error is not None or broken or not self._results:
            return "ERROR"
        return "FAIL" if self._verdict()[1] else "PASS"

    def _summary(self, error: Mapping[str, str] | None) -> dict[str, Any]:
        """Return the content of run.json."""
        runs = {name: result.run for name, result in self._results.items()}
        rows, reasons = self._verdict()
        errors = [{**run["error"], "vehicle": name} for name, run in runs.items() if run["error"] is not None]
        by_hand = [
            row | {"what": f"{name}: {row['what']}"} for name, run in runs.items() for row in run.get("by_hand", ())
        ]
        unmet = [f"{name}: {text}" for name, run in runs.items() for text in run.get("unmet", ())]
        stayed = [f"{name}: {run['unflown']}" for name, run in runs.items() if "unflown" in run]
        sim_s = self._ticks() * self._tick_ns / NS_PER_S
        flown_s = sum(run["sim_s"] for run in runs.values())
        setup_s, wall_s = (0.0, 0.0) if self._fleet is None else (self._fleet.setup_s, self._fleet.wall_s)
        return {
            "schema": 1,
            "status": self._status(),
            "error": error or next(iter(errors), None),
            "digest": self._digest(),
            "deterministic": bool(runs) and all(run["deterministic"] for run in runs.values()),
            "seed": self._bench.config.seed,
            "rig": self._bench.config.rig,
            "scene": self._bench.scene.name,
            "sim_s": sim_s,
            "wall_s": wall_s,
            "realtime_factor": sim_s / wall_s if wall_s > 0 else 0.0,
            "vehicle_s_per_s": flown_s / wall_s if wall_s > 0 else 0.0,
            "mission": {
                key: sum((run["mission"][key] for run in runs.values()), start=0) for key in ("waypoints", "reached")
            }
            | {"completed": bool(runs) and all(run["mission"]["completed"] for run in runs.values())},
            "verdict": {"reasons": reasons, "rows": [row.as_map() for row in rows]},
            "warnings": [{**row, "vehicle": name} for name, run in runs.items() for row in run["warnings"]],
            "contacts": [contact._asdict() for contact in self._measured.contacts],
            "vehicles": {
                name: {
                    "status": run["status"],
                    "lost": name in self._lost_with,
                    "error": run["error"],
                    "digest": run["digest"],
                    "rig": run["rig"],
                    "sim_s": run["sim_s"],
                    "mission": run["mission"],
                    "verdict": run["verdict"],
                    "autopilot": run.get("autopilot"),
                    "sensors": run.get("sensors"),
                    "folder": name,
                    **({"unflown": run["unflown"]} if "unflown" in run else {}),
                }
                for name, run in runs.items()
            },
            "skipped": [
                row | {"what": f"{name}: {row['what']}"} for name, run in runs.items() for row in run["skipped"]
            ],
            "actions": [],
            **({"by_hand": by_hand} if by_hand else {}),
            **({"unmet": unmet} if unmet else {}),
            **({"unflown": "; ".join(stayed)} if stayed and len(stayed) == len(runs) else {}),
            "timing": {"setup_s": setup_s, "total_s": time.monotonic() - self._began_s},
        }
