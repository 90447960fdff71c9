"""Everybody who commands the autopilot in one run: mission or pilot, script, sticks, and clients of the router."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_bridge.codecs.signing import SigningKey
from firmware_bridge.ground_station.actions import ActionSource, Record
from firmware_bridge.ground_station.modes import ARDUPILOT, PX4, mode_params
from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from firmware_bridge.ground_station.station import GroundStation
from firmware_bridge.manual.hid_gamepad import HidGamepad, open_gamepad
from firmware_bridge.manual.keyboard import KeyboardSticks, Terminal
from firmware_bridge.manual.manual_control import ARDUCOPTER_MODES, PX4_MODES, ManualControlSource, buttons_of
from firmware_bridge.manual.sticks import StickLost
from firmware_bridge.router import Router, RouterSource
from firmware_bridge.router_signing import AutopilotSide, ClientSide, SignedCommands, read_key
from hil.autopilots import State, geodetic_from_W
from hil.config import Bench, BenchConfig
from hil.dashboard.page_sticks import PageSticks, page_buttons
from hil.missions.script import Injected, flight_actions
from hil.recorder.recorder import Recorder
from hil.scheduler import CommandSource
from hil.signals._kernel import tangent_ned
from hil.signals.samples import TruthState
from hil.signals.time import NS_PER_S

if TYPE_CHECKING:
    from hil.companion.link import CompanionLink
    from hil.dashboard.live_run import LiveRun

# Simulated autopilots whose telemetry is sent by threads that run on wall-clock time: what the ground station asks of
# them, it asks on whole seconds of simulated time, so that a few milliseconds more or less make no other flight.
_ON_A_GRID = frozenset({"px4_sitl", "ardupilot_sitl"})
_GRID_NS = NS_PER_S
# A companion that has desired nothing new for so long, simulated time, is stale: the vehicle holds its position.
_STALE_S, _STALE_FRAMES = 1.0, 2.5


class Commanders:
    """`sources` are asked in their order at every tick; there are none before `open`."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self.sources: list[CommandSource] = []
        self.station: GroundStation | OffboardPilot | None = None
        self.manual: ManualControlSource | None = None
        self.page_manual: ManualControlSource | None = None  # sticks of the dashboard
        self.router: Router | None = None
        self._actions: ActionSource | None = None

    def open(
        self,
        stack: ExitStack,
        recorder: Recorder,
        *,
        state: State,
        companion: CompanionLink | None,
        live: LiveRun | None,
        inject: Callable[[Injected], None],
    ) -> None:
        """Make those that the bench asks for; `stack` closes them. `state`: of the vehicle before take-off."""
        config, script = self._bench.config, self._bench.script
        self.station = self._station(recorder, state)
        if isinstance(self.station, OffboardPilot) and companion is not None:
            self.sources.append(companion.timed(self.station))
        elif self.station is not None:
            self.sources.append(self.station)
        elif (
            config.autopilot.kind != "mock"
            and config.autopilot.on_restart == "error"
            and config.autopilot.mavlink_port != "none"
        ):
            # Real firmware wants to hear a ground station once a second.
            self.sources.append(GroundStation((), target_sysid=None, fly=False))
        if script is not None:
            self._actions = ActionSource(
                flight_actions(script, self._bench.mission, inject, tick_ns=config.tick_ns),
                target_sysid=None,
                first_item=1 if config.autopilot.kind.startswith("ardupilot") else 0,
                on_event=recorder.event,
            )
            self.sources.append(self._actions)
        if config.manual.device is not None:
            self.manual = _manual(config)
            stack.callback(self.manual.close)
            self.sources.append(self.manual)
        if live is not None:
            self.page_manual = _manual(config, live.sticks)
            self.sources.append(self.page_manual)
        autopilot_signs = None
        if config.autopilot.signing_key_file is not None:
            autopilot_signs = AutopilotSide(_key(config.autopilot.signing_key_file, recorder))
            self.sources = [SignedCommands(source, autopilot_signs) for source in self.sources]
        self.router = self._router(autopilot_signs, recorder)
        if self.router is not None:
            stack.callback(self.router.close)
            self.router.open()
            self.sources.append(RouterSource(self.router, recorder.event, recorder.overheard))

    def _station(self, recorder: Recorder, state: State) -> GroundStation | OffboardPilot | None:
        """Who sees to it that the vehicle flies what the bench is for."""
        config = self._bench.config
        grid_ns = _GRID_NS if config.autopilot.kind in _ON_A_GRID else 0
        if config.companion.on and config.companion.control:
            return _pilot(self._bench, state, recorder.event, grid_ns=grid_ns)
        if self._bench.mission is not None:
            return GroundStation(self._bench.mission.items, target_sysid=None, grid_ns=grid_ns)
        if self._bench.script is not None:
            # Nothing to upload and nobody to arm it but the script; the station sees it fly, land and disarm.
            return GroundStation((), target_sysid=None, fly=False)
        return None

    def _router(self, autopilot_signs: AutopilotSide | None, recorder: Recorder) -> Router | None:
        config = self._bench.config
        endpoints = config.router.endpoints()
        if not endpoints:
            return None
        key = config.router.signing_key_file
        faster = config.autopilot.lockstep and (config.pace is None or config.pace > 1.0)
        return Router(
            endpoints,
            hold=config.router.hold_heartbeats and faster,
            clients_sign=None if key is None else ClientSide(_key(key, recorder)),
            autopilot_signs=autopilot_signs,
        )

    def observers(self, recorder: Recorder) -> list[Callable[[TruthState], None]]:
        """Record what the sticks have had to say since the tick before."""
        sticks = (self.manual, self.page_manual)
        return [partial(_record_events, source, recorder) for source in sticks if source is not None]

    @property
    def from_outside(self) -> bool:
        """Whether something came in that no other run will have. Signatures carry wall-clock time."""
        return (
            self._bench.config.autopilot.signing_key_file is not None
            or (self.router is not None and self.router.received_any)
            or any(source is not None and source.sent > 0 for source in (self.manual, self.page_manual))
        )

    @property
    def records(self) -> tuple[Record, ...]:
        """What became of a script's actions."""
        return tuple(self._actions.records) if self._actions is not None else ()

    @property
    def reached(self) -> int:
        """Waypoints so far."""
        return 0 if self.station is None else self.station.reached

    @property
    def done(self) -> bool:
        """Whether whoever flies has ended the flight."""
        return self.station is not None and self.station.phase.value == "done"

    def status(self) -> tuple[str, int, int]:
        """Phase, waypoints reached, waypoints."""
        if self.station is None:
            return ("serving", 0, 0)
        return (self.station.phase.value, self.station.reached, self.station.waypoints)

    def texts(self) -> list[tuple[int, int, str]]:
        """What the autopilot has said: when [ns], MAV_SEVERITY, text."""
        return [] if self.station is None else self.station.statustexts

    def record_texts(self, recorder: Recorder) -> None:
        """What the autopilot has said as events: of severity 0 (emergency) to 3 errors, of 4 warnings."""
        for t_ns, severity, text in self.texts():
            recorder.event(t_ns, "error" if severity <= 3 else "warning" if severity == 4 else "status", text)


def _pilot(bench: Bench, state: State, on_event: Callable[[int, str, str], None], *, grid_ns: int) -> OffboardPilot:
    """Flies what a companion desires. `grid_ns`: times at which it may ask the autopilot, 0 for any."""
    config = bench.config
    return OffboardPilot(
        geodetic_from_W(config.autopilot.kind, bench.scene.site, state),
        tick_ns=config.tick_ns,
        setpoint_hz=config.companion.setpoint_hz,
        stale_s=max(_STALE_S, _STALE_FRAMES / config.companion.rate_hz),
        projection=tangent_ned if config.autopilot.is_mock else None,
        target_sysid=None,
        grid_ns=grid_ns,
        on_event=on_event,
    )


def _manual(config: BenchConfig, page: PageSticks | None = None) -> ManualControlSource:
    """The source of MANUAL_CONTROL: from the sticks of the dashboard's `page`, or of the device that the bench names.

    The page's are silent until somebody holds their switch, and may go back to the mission that they have taken over
    from. A gamepad that is not there yet is waited for in flight.
    ManualControlError: the keyboard is no terminal, or the gamepad cannot be flown with.
    """
    manual, copter = config.manual, config.autopilot.kind.startswith("ardupilot")
    modes = ARDUCOPTER_MODES if copter else PX4_MODES
    settings: dict[str, Any] = {
        "modes": modes,
        "rate_hz": manual.rate_hz,
        "neutral_s": manual.neutral_s,
        "target_sysid": None,
    }
    if page is not None:
        _, main, sub = mode_params(ARDUPILOT if copter else PX4, "MISSION")
        settings["modes"] = modes | {"mission": (main, sub)}
        return ManualControlSource(page, buttons=page_buttons(settings["modes"]), **settings)
    if manual.device == "keyboard":
        return ManualControlSource(KeyboardSticks(Terminal()), **settings)

    def reopen() -> HidGamepad:
        return open_gamepad(needs_dead_man=manual.needs_dead_man)

    try:
        pad = reopen()
    except StickLost:
        return ManualControlSource(None, reopen=reopen, **settings)
    return ManualControlSource(pad, reopen=reopen, buttons=buttons_of(pad.mapping), **settings)


def _record_events(source: ManualControlSource, recorder: Recorder, truth: TruthState) -> None:  # noqa: ARG001
    for event in source.take_events():
        recorder.event(*event)


def _key(path: str, recorder: Recorder) -> SigningKey:
    key, warning = read_key(Path(path))
    if warning:
        recorder.event(0, "warning", warning)
    return key
