"""The `hil` command. Exit status: 0 PASS, 1 FAIL (the vehicle), 2 wrong files or options, 3 ERROR (the bench)."""

from __future__ import annotations

import contextlib
import math
import re
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hil.detect.cli import detect_app
from hil.entry import CONFIG_STATUS, ERROR_STATUS
from hil.report.run_json import write_run_json
from hil.signals.errors import ConfigError, HilError, Problem, RecordingError

if TYPE_CHECKING:
    from hil.bench import RunResult
    from hil.config import Bench
    from hil.dashboard.live_run import LiveRun

app = typer.Typer(
    name="hil",
    help="A hardware-in-the-loop bench for drones: simulated vehicle and sensors, real or mocked flight controllers.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

# The library's base of all usage errors; it has no public name in typer.
_ClickError: type[typer.BadParameter] = typer.BadParameter.__mro__[2]

_out = Console(highlight=False, soft_wrap=True)
_err = Console(stderr=True, highlight=False, soft_wrap=True)

ConfigArgument = Annotated[Path | None, typer.Argument(help="Bench file; default ./hil.yaml.", metavar="[CONFIG]")]
RigOption = Annotated[str | None, typer.Option(help="Rig: which autopilot, over which wires (rigs/*.yaml).")]
SceneOption = Annotated[str | None, typer.Option(help="Scene (rigs/scenes/*.yaml).")]
MissionOption = Annotated[str | None, typer.Option(help="Mission: a .plan or .waypoints file, or a script (.yaml).")]
SeedOption = Annotated[int | None, typer.Option(help="Seed of all noise.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="Override any key, e.g. --set sensors.gps.rate_hz=5. May be repeated.", metavar="KEY=VALUE"
    ),
]
OutOption = Annotated[Path | None, typer.Option(help="Folder for the results; default runs/<time>-<rig>.")]
DashHostOption = Annotated[
    str, typer.Option(help="Address to serve the page on; any but loopback needs the token that is printed.")
]
DashPortOption = Annotated[int, typer.Option(help="Port of the page; 0: any that is free.", min=0, max=65535)]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, only the result.")]


def complain(error: HilError) -> None:
    """Every problem on a line of its own, on standard error."""
    lines = [str(p) for p in error.problems] if isinstance(error, ConfigError) else [str(error)]
    with contextlib.suppress(OSError, ValueError):  # nobody may be there to read it; the status tells
        for line in lines:
            _err.print(f"[bold red]error:[/] {escape(line)}")


@contextlib.contextmanager
def told() -> Iterator[None]:
    """Errors of the block on standard error, and the exit status that goes with them."""
    try:
        yield
    except HilError as error:
        complain(error)
        raise typer.Exit(CONFIG_STATUS if isinstance(error, ConfigError) else ERROR_STATUS) from None


def new_run_dir(out: Path | None, rig: str, runs: Path = Path("runs")) -> Path:
    """The folder of a run, in `runs` unless `out` is it, and `runs/latest` pointing there. RecordingError."""
    if out is not None:
        return out
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", Path(rig).stem) or "run"
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}-{name[:80]}"
    try:
        runs.mkdir(parents=True, exist_ok=True)
        for n in range(1000):
            folder = runs / (stem if n == 0 else f"{stem}-{n}")
            try:
                folder.mkdir()
            except FileExistsError:
                continue
            latest = runs / "latest"
            # A convenience: a file system without links, or a folder of that name, does not stop a run.
            with contextlib.suppress(OSError):
                latest.unlink(missing_ok=True)
                latest.symlink_to(folder.name)
            return folder
    except OSError as error:
        raise RecordingError(f"{runs}: no folder for the run can be made here ({error.strerror or error})") from error
    raise RecordingError(f"{runs}: a thousand runs began in the same second")


@app.command()
def run(
    config: ConfigArgument = None,
    rig: RigOption = None,
    scene: SceneOption = None,
    mission: MissionOption = None,
    seed: SeedOption = None,
    out: OutOption = None,
    settings: SetOption = None,
    quiet: QuietOption = False,
    dash: Annotated[bool, typer.Option("--dash", help="With a page in the browser that follows the flight.")] = False,
    dash_host: DashHostOption = "127.0.0.1",
    dash_port: DashPortOption = 8710,
    dash_fd: Annotated[int | None, typer.Option("--dash-fd", hidden=True)] = None,
    dash_pace: Annotated[float | None, typer.Option("--dash-pace", hidden=True, min=0.01, max=1000.0)] = None,
    dash_paused: Annotated[bool, typer.Option("--dash-paused", hidden=True)] = False,
    dash_runs: Annotated[Path, typer.Option("--dash-runs", hidden=True)] = Path("runs"),
) -> None:
    """Fly a mission on a rig and judge the flight."""
    began_s = time.monotonic()
    from hil.config import load_bench

    try:
        bench = load_bench(config, rig=rig, scene=scene, mission=mission, seed=seed, settings=settings or ())
    except ConfigError as error:
        complain(error)
        with contextlib.suppress(HilError):  # the message is out; no folder to leave run.json in is no second one
            _leave_config_error(error, new_run_dir(out, rig or "unknown", dash_runs), rig=rig, scene=scene, seed=seed)
        raise typer.Exit(CONFIG_STATUS) from None
    from hil.bench import run_bench

    result: RunResult | None = None
    try:
        folder = new_run_dir(out, bench.config.rig, dash_runs)
        with contextlib.ExitStack() as stack:
            live: LiveRun | None = None
            if dash:
                from hil.dash_command import dashboard_beside

                runs = folder.resolve().parent
                live = stack.enter_context(dashboard_beside(config, _out, host=dash_host, port=dash_port, runs=runs))
            elif dash_fd is not None:
                from hil.dash_command import live_on_fd

                live = live_on_fd(dash_fd, paused=dash_paused, pace=dash_pace)
                stack.callback(live.close)
            result = run_bench(bench, folder, quiet=quiet, live=live)
            with contextlib.suppress(OSError, ValueError):
                _print_result(result.run, folder, time.monotonic() - began_s)
    except HilError as error:  # not even the folder could be written, or the page not be served
        complain(error)
        raise typer.Exit(ERROR_STATUS) from None
    except KeyboardInterrupt:
        if result is None:
            raise
    assert result is not None
    raise typer.Exit(result.exit_status)


@app.command()
def check(
    config: ConfigArgument = None,
    rig: RigOption = None,
    scene: SceneOption = None,
    mission: MissionOption = None,
    settings: SetOption = None,
) -> None:
    """Validate a bench without running it: print every problem, exit 2 if there is any."""
    from hil.config import load_bench

    try:
        bench = load_bench(config, rig=rig, scene=scene, mission=mission, settings=settings or ())
        _check_wiring(bench)
    except HilError as error:
        complain(error)
        raise typer.Exit(CONFIG_STATUS) from None
    c = bench.config
    flown = f"{len(bench.mission.items)} mission items" if bench.mission else "no mission"
    if bench.script is not None:
        flown += f", {len(bench.script.script.actions)} actions"
    _out.print(f"ok: rig {c.rig}, scene {c.scene}, vehicle {c.vehicle}, {flown}, sensors {', '.join(c.sensors)}")


@app.command()
def dataset(
    config: Annotated[
        Path | None,
        typer.Argument(help="Bench file; default a square over the city park, with all sensors.", metavar="[CONFIG]"),
    ] = None,
    frames: Annotated[int | None, typer.Option(help="How many; default 500.", show_default=False)] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for it; default runs/<time>-dataset.")] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes that draw and write; default one a core.", show_default=False)
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what an interrupted one left in --out.")] = False,
    quality: Annotated[
        str | None, typer.Option(help="low, medium, high, epic, cinematic; default as the file says.")
    ] = None,
    seed: SeedOption = None,
    settings: SetOption = None,
    quiet: QuietOption = False,
) -> None:
    """Fly, and record labelled data of all sensors: EuRoC, VOC and COCO files, and an MCAP of it all."""
    from hil.dataset.command import run_dataset

    with told():
        if resume and out is None:
            raise ConfigError([Problem("--resume", "needs --out: the folder to go on with")])
        run_dataset(
            _out,
            config,
            frames=frames,
            out=new_run_dir(out, "dataset"),
            workers=workers,
            resume=resume,
            quality=quality,
            seed=seed,
            settings=settings or (),
            quiet=quiet,
        )


@app.command()
def replay(
    run_dir: Annotated[Path, typer.Argument(help="Folder of a run.", metavar="RUN_DIR")],
    out: Annotated[Path | None, typer.Option(help="Folder for the fresh run; default RUN_DIR/replay.")] = None,
) -> None:
    """Run a recorded configuration again; exit 1 and name the first differing tick and port if not identical."""
    from hil.bench import run_bench
    from hil.companion.trace_name import TRACE_NAME
    from hil.config import load_bench
    from hil.replay import replay as run_and_compare

    def again(config: Path, folder: Path) -> None:
        # Companions are not asked again: what they answered is in the trace.
        trace = run_dir / TRACE_NAME
        settings = [f"companion.trace={trace.resolve()}"] if trace.is_file() else []
        fresh = run_bench(load_bench(config, settings=settings), folder)
        if fresh.status == "ERROR":
            _err.print(f"the fresh run ended as an error: {fresh.run['error']['message']}", markup=False)

    with told():
        result = run_and_compare(run_dir, again, out_dir=out)
    _out.print(str(result))
    raise typer.Exit(0 if result.identical else 1)


@app.command()
def bench(
    name: Annotated[str, typer.Argument(help="Which benchmark.", metavar="NAME")],
    json: Annotated[Path | None, typer.Option(help="Write rows and checks to this file, the plot beside it.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="At most 60 s; says which checks it leaves out.")] = False,
) -> None:
    """Measure run time against error; exit 1 if a check is not met."""
    from hil.bench_suite.suite import BENCHMARKS, run_benchmark

    if name not in BENCHMARKS:
        _err.print(f"[bold red]error:[/] no benchmark {name!r}; there are: {', '.join(BENCHMARKS)}")
        raise typer.Exit(CONFIG_STATUS)
    try:
        met = run_benchmark(name, json=json, quick=quick, console=_out)
    except HilError as error:
        complain(error)
        raise typer.Exit(ERROR_STATUS) from None
    raise typer.Exit(0 if met else 1)


@app.command()
def devices(
    json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
    watch: Annotated[bool, typer.Option("--watch", help="Then print every change until Ctrl-C.")] = False,
    check: Annotated[
        str | None,
        typer.Option("--check", help="Ask the board on this port whether it is set up for HITL.", metavar="PORT"),
    ] = None,
    fix: Annotated[bool, typer.Option("--fix", help="With --check: set what is wrong and restart the board.")] = False,
    baud: Annotated[int, typer.Option(help="With --check: of a real serial line.")] = 921_600,
) -> None:
    """Serial ports, USB autopilots, gamepads."""
    from hil.devices_command import check_board, print_devices

    if check is None:
        print_devices(_out, as_json=json, watch=watch)
        return
    try:
        ready = check_board(_out, check, baud=baud, fix=fix)
    except HilError as error:
        complain(error)
        raise typer.Exit(ERROR_STATUS) from None
    raise typer.Exit(0 if ready else 1)


@app.command()
def view(
    scene: Annotated[str, typer.Argument(help="Scene: a name (rigs/scenes/*.yaml) or a file.", metavar="SCENE")],
    out: Annotated[Path | None, typer.Option(help="Folder for the pictures; default runs/view-<scene>.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of a generated map; default the scene's own.")] = None,
    at: Annotated[str | None, typer.Option(help="Where to stand, in metres.", metavar="X,Y,Z")] = None,
    look: Annotated[
        str | None, typer.Option(help="Degrees from east to north, and downwards.", metavar="YAW,PITCH")
    ] = None,
    size: Annotated[str | None, typer.Option(help="Pixels; default 640x480.", metavar="WxH")] = None,
    quality: Annotated[str | None, typer.Option(help="low, medium, high, epic or cinematic.")] = None,
    variants: Annotated[
        int, typer.Option(min=0, max=64, help="One sheet of so many seeds of `randomize` instead.", metavar="N")
    ] = 0,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="weather or randomize, e.g. --set weather.visibility_m=800.", metavar="KEY=VALUE"),
    ] = None,
) -> None:
    """Pictures of a scene in every channel that a camera can have."""
    from hil.view_command import view_scene

    with told():
        chosen = [*(settings or ()), *([f"quality={quality}"] if quality is not None else ())]
        files = view_scene(scene, out, seed=seed, at=at, look=look, size=size, variants=variants, settings=chosen)
    _out.print(f"{files[0]}  and {len(files) - 1} more pictures beside it", markup=False)


@app.command()
def dash(
    config: ConfigArgument = None,
    host: DashHostOption = "127.0.0.1",
    port: DashPortOption = 8710,
    runs: Annotated[Path, typer.Option(help="Folder of the runs that can be opened.")] = Path("runs"),
) -> None:
    """A page in the browser: start and follow runs, fly by hand, open past runs."""
    from hil.dash_command import serve_dashboard

    with told():
        serve_dashboard(config, _out, host=host, port=port, runs=runs)


@app.command()
def keys(
    folder: Annotated[Path, typer.Argument(help="Where they are kept; made if it is not there.", metavar="DIR")],
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Clients to make a pair for; the bench's own is made once.", metavar="NAME"),
    ] = None,
) -> None:
    """Key pairs for the companion link: of the bench and of its clients. Overwrites nothing."""
    from hil.keys_command import make_key_pairs

    try:
        make_key_pairs(folder, names or (), _out)
    except ConfigError as error:
        complain(error)
        raise typer.Exit(CONFIG_STATUS) from None


@app.command()
def companion(
    name: Annotated[
        str, typer.Argument(help="echo, record, waypoints, explore, or MODULE:NAME of your own.", metavar="NAME")
    ],
    connect: Annotated[str, typer.Option(help="tcp://HOST:PORT or ipc://FILE of a bench.", metavar="ADDR")],
    client_name: Annotated[str | None, typer.Option("--name", help="What the bench calls it; default NAME.")] = None,
    topics: Annotated[
        list[str] | None, typer.Option(help="What to receive, shell patterns, e.g. front/*,imu.", metavar="A,B")
    ] = None,
    key: Annotated[Path | None, typer.Option(help="This client's secret key (`hil keys`).", metavar="FILE")] = None,
    bench_key: Annotated[Path | None, typer.Option(help="The bench's public key.", metavar="FILE")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="A setting of the client. May be repeated.", metavar="KEY=VALUE")
    ] = None,
    control: Annotated[bool, typer.Option("--control", help="Ask to command, for one of your own.")] = False,
    hold: Annotated[
        bool, typer.Option("--hold", help="What it desires is flown as it stands, not carried on.")
    ] = False,
    credit: Annotated[int, typer.Option(help="Frames on the way at once.")] = 1,
    no_shared_memory: Annotated[
        bool, typer.Option("--no-shared-memory", help="Even where the bench is on this machine.")
    ] = False,
    wait: Annotated[float, typer.Option(help="Seconds for the bench to be there.")] = 30.0,
    reconnect: Annotated[float, typer.Option(help="Seconds to come back after a loss; default for ever.")] = math.inf,
) -> None:
    """Run a client under test against a bench."""
    from hil.companion_command import run_companion

    status = run_companion(
        name,
        connect,
        name=client_name,
        topics=topics or (),
        key=key,
        bench_key=bench_key,
        settings=settings or (),
        control=control,
        hold=hold,
        credit=credit,
        shared_memory=not no_shared_memory,
        wait_s=wait,
        reconnect_s=reconnect,
    )
    raise typer.Exit(status)


calibrate = typer.Typer(no_args_is_help=True, help="A sensor's preset from a recording of your own sensor.")
app.add_typer(calibrate, name="calibrate")
app.add_typer(detect_app, name="detect")


@calibrate.callback()
def _calibrate() -> None:
    """A sensor's preset from a recording of your own sensor."""


@calibrate.command("radar")
def calibrate_radar(
    recording: Annotated[
        Path, typer.Argument(help=".npz (array adc) or .npy, with its .json beside it.", metavar="RECORDING")
    ],
    frames: Annotated[
        str | None, typer.Option(help="Which frames to fit; default all.", metavar="FIRST:END", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The preset; default NAME.yaml here.", metavar="FILE")] = None,
    name: Annotated[str | None, typer.Option(help="What to call it; default the recording's name.")] = None,
    keep_echoes: Annotated[
        bool, typer.Option("--keep-echoes", help="Leave the reflectors of the scene in the fixed pattern.")
    ] = False,
) -> None:
    """Fit leakage, noise and converter to a recording of an empty, still scene."""
    from hil.calibrate_command import calibrate_radar as fit_radar

    with told():
        files = fit_radar(recording, _out, frames=frames, out=out, name=name, keep_echoes=keep_echoes)
    _out.print(f"{files.preset}  and its picture {files.picture}", markup=False)


@app.command()
def radar(
    target: Annotated[
        Path,
        typer.Argument(
            help="Folder of a run, its run.mcap, or a recording (.npz or .npy with its .json).", metavar="RECORDING"
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default `radar` beside the data.")] = None,
    preset: Annotated[
        str | None, typer.Option(help="Radar preset, by name or file; default the recorded radar's settings.")
    ] = None,
    sensor: Annotated[str | None, typer.Option(help="Which radar, where the recording has several.")] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Override any key, e.g. --set processing.cfar.kind=ca.", metavar="KEY=VALUE"),
    ] = None,
    from_s: Annotated[
        float | None, typer.Option("--from", help="First time of the frames taken [s].", metavar="S")
    ] = None,
    until_s: Annotated[float | None, typer.Option("--until", help="Last time of them [s].", metavar="S")] = None,
    quiet: QuietOption = False,
) -> None:
    """Radar data of a recording to maps, points and tracks; without radar data, made from its pictures."""
    from hil.radar_command import process_radar

    with told():
        files = process_radar(
            target,
            _out,
            out=out,
            preset=preset,
            sensor=sensor,
            settings=settings or (),
            from_s=from_s,
            until_s=until_s,
            quiet=quiet,
        )
    _out.print(f"{files[0]}  and {len(files) - 1} more files beside it", markup=False)


def _check_wiring(bench: Bench) -> None:
    from hil.stages import plan_stages
    from hil.wiring import stage_specs

    plan_stages(stage_specs(bench.config))


def _leave_config_error(
    error: ConfigError, folder: Path, *, rig: str | None, scene: str | None, seed: int | None
) -> None:
    """run.json of a run that never began, so that a caller always finds one."""
    zero = {"p50": None, "p99": None, "max": None}
    run = {
        "schema": 1,
        "status": "ERROR",
        "error": {"type": "ConfigError", "message": str(error)},
        "digest": "0" * 32,
        "deterministic": False,
        "seed": seed or 0,
        "rig": rig or "",
        "scene": scene or "",
        "sim_s": 0.0,
        "wall_s": 0.0,
        "realtime_factor": 0.0,
        "mission": {
            "completed": False,
            "waypoints": 0,
            "reached": 0,
            "max_cross_track_m": None,
            "final_error_m": None,
        },
        "autopilot": {"kind": "", "steps": 0, "late": 0, "rtt_us": zero},
        "sensors": {},
        "skipped": [],
    }
    write_run_json(folder / "run.json", run)


def _print_result(run: dict[str, object], folder: Path, took_s: float) -> None:
    """The headline of a run, as a person wants to read it."""
    colour = {"PASS": "green", "FAIL": "yellow"}.get(str(run["status"]), "red")
    table = Table.grid(padding=(0, 2))
    mission: dict[str, object] = run["mission"]  # type: ignore[assignment]
    verdict: dict[str, list[dict[str, object]]] = run["verdict"]  # type: ignore[assignment]
    if mission["waypoints"]:
        table.add_row("waypoints", f"{mission['reached']} of {mission['waypoints']}")
    for row in verdict["rows"]:
        if row["value"] is not None:
            limit = f"(limit {row['limit']:g})" if row["limit"] is not None else "(not judged)"
            table.add_row(
                str(row["name"]).rsplit("_", 1)[0].replace("_", " "), f"{row['value']:.3f} {row['unit']} {limit}"
            )
    table.add_row(
        "speed", f"{run['sim_s']:.1f} s simulated in {run['wall_s']:.1f} s: {run['realtime_factor']:.1f}x real time"
    )
    companion: dict[str, object] | None = run.get("companion")  # type: ignore[assignment]
    if companion:
        from hil.report.companion_table import console_rows

        for label, text in console_rows(companion):
            table.add_row(label, text)
    same = "" if run["deterministic"] else "  (not deterministic)"
    _out.print(f"[bold {colour}]{run['status']}[/]")
    error: dict[str, str] | None = run["error"]  # type: ignore[assignment]
    if error:
        _err.print(f"[bold red]error:[/] {escape(error['type'])}: {escape(error['message'])}")
    for reason in verdict["reasons"] if run["status"] == "FAIL" else []:
        _out.print(f"  {reason}", markup=False)
    _out.print(table)
    # Unbroken lines, so that they can be copied, compared and searched for.
    _out.print(f"digest   {run['digest']}{same}", markup=False)
    _out.print(f"results  {folder}/  (report.html, run.json; {took_s:.1f} s in all)", markup=False)


def run_command_line(arguments: Sequence[str]) -> int:
    """Run one command and return its exit status. KeyboardInterrupt passes through."""
    try:
        outcome = app(args=list(arguments), prog_name="hil", standalone_mode=False)
    except typer.Exit as leaving:
        return leaving.exit_code
    except typer.Abort:
        raise KeyboardInterrupt from None
    except _ClickError as error:
        error.show()
        return error.exit_code
    return outcome if isinstance(outcome, int) else 0


if __name__ == "__main__":
    from hil.entry import main

    main()
