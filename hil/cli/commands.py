"""All commands but `hil run` and `hil detect`: options, and the call that does the work.

`hil companion`: a client under test on this machine.

The client lives in `rigs/jetson`, as a package of its own that knows nothing of the bench, so that it can be copied to
a companion computer, where `python -m hil_companion` is the same. From here it is found by that path.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import (
    ConfigArgument,
    DashHostOption,
    DashPortOption,
    MissionOption,
    QuietOption,
    RigOption,
    SceneOption,
    SeedOption,
    SetOption,
    console,
    error_console,
    told,
)
from hil.entry import CONFIG_STATUS
from hil.run_folder import new_run_dir
from hil.signals.errors import ConfigError, Problem


def check(
    config: ConfigArgument = None,
    rig: RigOption = None,
    scene: SceneOption = None,
    mission: MissionOption = None,
    settings: SetOption = None,
) -> None:
    """Validate a bench without running it: print every problem, exit 2 if there is any."""
    from hil.config import load_bench
    from hil.frame_stages import stage_specs
    from hil.stages import plan_stages

    with told(CONFIG_STATUS):
        bench = load_bench(config, rig=rig, scene=scene, mission=mission, settings=settings or ())
        plan_stages(stage_specs(bench.config))
    c = bench.config
    flown = f"{len(bench.mission.items)} mission items" if bench.mission else "no mission"
    if bench.script is not None:
        flown += f", {len(bench.script.script.actions)} actions"
    console.print(f"ok: rig {c.rig}, scene {c.scene}, vehicle {c.vehicle}, {flown}, sensors {', '.join(c.sensors)}")


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
            console,
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


def replay(
    run_dir: Annotated[Path, typer.Argument(help="Folder of a run.", metavar="RUN_DIR")],
    out: Annotated[Path | None, typer.Option(help="Folder for the fresh run; default RUN_DIR/replay.")] = None,
) -> None:
    """Run a recorded configuration again; exit 1 and name the first differing tick and port if not identical."""
    from hil.replay import fly_and_compare

    with told():
        result = fly_and_compare(run_dir, out, error_console)
    console.print(str(result))
    raise typer.Exit(0 if result.identical else 1)


def bench(
    name: Annotated[str, typer.Argument(help="Which benchmark.", metavar="NAME")],
    json: Annotated[Path | None, typer.Option(help="Write rows and checks to this file, the plot beside it.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="At most 60 s; says which checks it leaves out.")] = False,
) -> None:
    """Measure run time against error; exit 1 if a check is not met."""
    from hil.bench_suite.suite import BENCHMARKS, run_benchmark

    if name not in BENCHMARKS:
        error_console.print(f"[bold red]error:[/] no benchmark {name!r}; there are: {', '.join(BENCHMARKS)}")
        raise typer.Exit(CONFIG_STATUS)
    with told():
        met = run_benchmark(name, json=json, quick=quick, console=console)
    raise typer.Exit(0 if met else 1)


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
        print_devices(console, as_json=json, watch=watch)
        return
    with told():
        ready = check_board(console, check, baud=baud, fix=fix)
    raise typer.Exit(0 if ready else 1)


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
    console.print(f"{files[0]}  and {len(files) - 1} more pictures beside it", markup=False)


def dash(
    config: ConfigArgument = None,
    host: DashHostOption = "127.0.0.1",
    port: DashPortOption = 8710,
    runs: Annotated[Path, typer.Option(help="Folder of the runs that can be opened.")] = Path("runs"),
) -> None:
    """A page in the browser: start and follow runs, fly by hand, open past runs."""
    from hil.dash_command import serve_dashboard

    with told():
        serve_dashboard(config, console, host=host, port=port, runs=runs)


def keys(
    folder: Annotated[Path, typer.Argument(help="Where they are kept; made if it is not there.", metavar="DIR")],
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Clients to make a pair for; the bench's own is made once.", metavar="NAME"),
    ] = None,
) -> None:
    """Key pairs for the companion link: of the bench and of its clients. Overwrites nothing."""
    from firmware_bridge.companion.keys import BENCH, make_keys

    with told():
        for file in make_keys(folder, names or ()):
            console.print(str(file), markup=False)
    for name in names or ():
        console.print(
            f"{name}: take {name}.key and {BENCH}.pub to its machine, then remove {name}.key here; "
            f"whoever's .pub stays here may connect",
            markup=False,
        )


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
            console,
            out=out,
            preset=preset,
            sensor=sensor,
            settings=settings or (),
            from_s=from_s,
            until_s=until_s,
            quiet=quiet,
        )
    console.print(f"{files[0]}  and {len(files) - 1} more files beside it", markup=False)


calibrate_app = typer.Typer(no_args_is_help=True, help="A sensor's preset from a recording of your own sensor.")


@calibrate_app.callback()
def _calibrate() -> None:
    """A sensor's preset from a recording of your own sensor."""


@calibrate_app.command("radar")
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
        files = fit_radar(recording, console, frames=frames, out=out, name=name, keep_echoes=keep_echoes)
    console.print(f"{files.preset}  and its picture {files.picture}", markup=False)


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
    from hil.companion.started import use_client

    use_client()
    from hil_companion.command import start, topic_list

    status: int = start(
        name,
        connect,
        name=client_name,
        topics=topic_list(topics or ()),
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
