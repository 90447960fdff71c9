"""`hil airsim`: read the bench and settings.json, open the port, and serve until a signal ends it."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import hashlib
import json
import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from firmware_bridge.autopilots.catalog import PROFILES
from firmware_bridge.transports.loopback_host import is_loopback
from hil.apps.airsim.api.catalog import method_table
from hil.apps.airsim.clock import CallsClock, WallClock
from hil.apps.airsim.rpc.server import RpcServer
from hil.apps.airsim.settings.files import load_settings
from hil.apps.airsim.settings.scene_names import scene_name
from hil.apps.airsim.settings.settings import AirSimSettings
from hil.apps.airsim.simulation import RIGS, TICK_NS, Simulation
from hil.config import Bench, load_bench
from hil.config.saved import save_bench
from hil.run.report.run_folder import new_run_dir
from signals.errors import ConfigError, HilError, file_errors
from signals.stop_signals import stop_signals
from signals.time import NS_PER_S
from sim.scene.compile.placed_worlds import limit_mesh_cache

if TYPE_CHECKING:
    from hil.apps.airsim.served_page import ServedPage
    from hil.run.feed.live_run import LiveRun

_LONGEST_LINE = 1000
PageServer = Callable[[Path], contextlib.AbstractContextManager["LiveRun"]]  # of the folder of runs


@dataclass(frozen=True)
class Choice:
    """Options of the command."""

    config: Path | None = None
    settings: str | None = None  # a file, or JSON text
    clock: str = "wall"
    host: str | None = None  # None: LocalHostIp of the settings, or loopback
    port: int | None = None  # None: ApiServerPort of the settings
    scene: str | None = None
    out: Path | None = None
    files: Path | None = None  # folder of the files that clients have written; None: that of the results
    page: PageServer | None = None  # serves a page that shows the scene, the vehicles and the drawings


def printable(text: str) -> str:
    """Return a text of a client without what could move a terminal's cursor, and not too long."""
    shown = text if len(text) <= _LONGEST_LINE else f"{text[:_LONGEST_LINE]}..."
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogateescape").decode() for c in shown)


class TruthDigest:
    """Digest over the true states of all vehicles at every tick."""

    def __init__(self, simulation: Simulation) -> None:
        self._hash = hashlib.sha256()
        simulation.world.observers.append(self._add)

    def _add(self, world: Any) -> None:
        for vehicle in world.vehicles.values():
            t = vehicle.truth
            state = (*t.p_WB, *t.q_WB, *t.v_WB_W, *t.w_WB_B, *t.a_WB_W, *t.alpha_WB_B, *t.rotor_speed_radps)
            self._hash.update(struct.pack(f"<q{len(state)}d?", t.t_ns, *state, t.in_contact))

    def hexdigest(self) -> str:
        """Return the digest so far."""
        return self._hash.hexdigest()


def serve_airsim(choice: Choice, console: Console) -> None:
    """Serve until SIGINT or SIGTERM, and write OUT/airsim.json. Raises HilError."""
    settings, source = load_settings(choice.settings)
    simulation = make_simulation(choice, settings, lambda text: console.print(printable(text), markup=False))
    for note in settings.notes:
        console.print(note, markup=False)
    console.print(f"settings: {source}", markup=False)
    began_s = time.monotonic()
    with contextlib.ExitStack() as stack:
        results = cache(lambda: stack.enter_context(new_run_dir(choice.out, "airsim")))
        simulation.files.folder = lambda: results() if choice.files is None else choice.files
        if not settings.recording.folder and choice.out is not None:
            simulation.recorder.folder = choice.out
        try:
            simulation.cameras.prepare()
            limit_mesh_cache()
            if settings.recording.enabled:
                simulation.recorder.start()
            with _page(choice, simulation, results) as page:
                server = asyncio.run(_serve(choice, simulation, console, page))
        finally:
            simulation.close()
        folder = results()
    report = _report(choice, simulation, server, time.monotonic() - began_s)
    with file_errors(folder / "airsim.json"):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "airsim.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    if report["refused"]:
        counts = ", ".join(f"{name} {count}" for name, count in report["refused"].items())
        console.print(f"calls that were refused: {counts}", markup=False)
    digest = f", digest {report['digest'][:16]}" if report["digest"] else ""
    sim_s, wall_s = report["sim_s"], report["wall_s"]
    console.print(f"served {sim_s:.3f} s of simulated time in {wall_s:.1f} s{digest}: {folder}", markup=False)


def make_simulation(choice: Choice, settings: AirSimSettings, log: Callable[[str], None]) -> Simulation:
    """Return the simulation of a bench with the settings. Raises ConfigError."""
    scene = scene_name(choice.scene or settings.scene)
    bench = load_bench(choice.config, scene=scene or None, flown=False)
    for key, served in (("foxglove.port", bench.config.foxglove.port), ("ros2.domain", bench.config.ros2.domain)):
        if served is not None:
            log(f"{key} is ignored: hil airsim serves AirSim's clients only")

    def rig(name: str) -> Bench:
        own = bench.config.autopilot.profile.firmware == PROFILES[name].firmware
        return load_bench(
            choice.config,
            rig=None if own else name,
            scene=scene or None,
            settings=(f"tick_hz={NS_PER_S // TICK_NS}",),
            flown=False,
        )

    return Simulation(bench, settings, log, rig)


@contextlib.contextmanager
def _page(choice: Choice, simulation: Simulation, results: Callable[[], Path]) -> Iterator[ServedPage | None]:
    """Serve the dashboard's page, if it is wanted. The folder of the results holds its scene."""
    if choice.page is None:
        yield None
        return
    from hil.apps.airsim.served_page import ServedPage

    folder = results()
    with choice.page(folder.resolve().parent) as live:
        with file_errors(folder):
            save_bench(simulation.bench, folder)
        yield ServedPage(simulation, live, folder)


async def _serve(choice: Choice, simulation: Simulation, console: Console, page: ServedPage | None) -> RpcServer:
    settings = simulation.settings
    host = choice.host if choice.host is not None else settings.host or "127.0.0.1"
    port = choice.port if choice.port is not None else settings.port
    repeatable = choice.clock == "calls"
    server = RpcServer(method_table(simulation), simulation.log, digest=repeatable)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in stop_signals():
        with contextlib.suppress(NotImplementedError, ValueError):
            loop.add_signal_handler(number, stop.set)
    clock = CallsClock(simulation) if repeatable else WallClock(simulation, settings.clock_speed)
    truths = TruthDigest(simulation) if repeatable else None
    chosen = await server.start(host, port)
    if settings.recording.enabled:
        simulation.recorder.start()
    if not is_loopback(host):
        console.print(
            f"warning: everybody who reaches {host}:{chosen} can fly these vehicles, because AirSim's protocol has no "
            "keys; leave --host out to serve this computer alone",
            markup=False,
        )
    names = ", ".join(simulation.drones)
    console.print(
        f"airsim: {host}:{chosen}, scene {simulation.scene.name}, vehicles {names}, clock {choice.clock}   "
        "(Ctrl-C ends it)",
        markup=False,
    )
    gc.collect()
    gc.freeze()  # the scene stays: a search through it would hold up the clients
    running, stopped = asyncio.create_task(clock.run()), asyncio.create_task(stop.wait())
    shown = None if page is None else asyncio.create_task(page.run())
    await asyncio.wait({running, stopped}, return_when=asyncio.FIRST_COMPLETED)
    gc.unfreeze()
    await server.stop()
    for task in (running, stopped, shown):
        if task is not None and not task.done():
            task.cancel()
    if running.done() and not running.cancelled():
        try:
            running.result()  # raises the error that ended the clock
        except ConfigError as error:
            raise HilError(str(error)) from error  # it has served: what it wrote stays
    if truths is not None and server.digest is not None:
        server.digest.update(truths.hexdigest().encode())
    return server


def _report(choice: Choice, simulation: Simulation, server: RpcServer, wall_s: float) -> dict[str, Any]:
    table = server.methods
    return {
        "clock": choice.clock,
        "scene": simulation.scene.name,
        "vehicles": list(simulation.drones),
        "sim_s": simulation.world.t_ns / NS_PER_S,
        "wall_s": wall_s,
        "clients": server.clients,
        "repeatable": choice.clock == "calls" and not any(d.settings.kind in RIGS for d in simulation.drones.values()),
        "calls": dict(sorted(table.calls.items())),
        "drawings": dict(sorted(simulation.drawings.counts.items())),
        "refused": dict(sorted(table.refused.items())),
        "unknown": dict(sorted(table.unknown.items())),
        "digest": server.digest.hexdigest() if server.digest is not None else None,
    }
