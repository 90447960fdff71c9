"""`hil bench skip`: what each rule of skipping saves, and that it changes nothing.

A rule leaves out work that cannot matter. Each is switched off alone, all others on, and the outputs are held against
each other bit for bit; the table has the time with and without it.

    raster    every field of RenderSkips; channels that nobody asked for; actors that the camera cannot see, not posed
    LiDAR     nothing beyond the greatest range is looked at; the tree over the geometry leaves out what no ray meets
    radar     no maps, points and tracks where raw frames are all that is asked for
    physics   no contact work while nothing can touch

The raster's rules are measured with colour, depth, segmentation and shadows at 320 x 240, over random viewpoints; each
picture follows one of another time and place. Times are of one thread: the best of some turns, on and off in turn.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.bench_suite.raster import buffers
from hil.bench_suite.raster_cases import SCENES, Case, View, scene_case
from hil.bench_suite.result import BenchmarkResult, Check, Row, save_figure
from hil.bench_suite.skip_radar import unread_outputs
from hil.bench_suite.timing import one_core
from hil.signals.samples import TruthState
from sim._kernels import RayCaster
from sim.frame.camera_model import CameraModel
from sim.frame.channels import CHANNELS
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer, RenderSkips
from sim.physics.quadrotor import QuadrotorPhysics
from sim.physics.vehicle import load_vehicle
from sim.scene.scene import load_scene

Say = Callable[[str], None]
Outputs = dict[str, NDArray[Any]]
_COLOUR = ("rgb", "depth", "segmentation")
_POSED = "unseen_actors"  # a field of RenderSkips that saves posing: measured with it
_LIDAR_RANGE_M = 50.0


@dataclass(frozen=True)
class Rule:
    """`run(on)` yields once for each output: seconds that it took, and the output as it must be on or off."""

    name: str
    case: str
    run: Callable[[bool], Iterator[tuple[float, Outputs]]]


def measure(*, quick: bool, say: Say, seed: int = 1) -> BenchmarkResult:
    """Every rule on and off; `seed` chooses the viewpoints."""
    result = BenchmarkResult(time_label="wall time [s]")
    scenes = SCENES[:1] if quick else SCENES
    differing = 0
    with one_core():
        rules: list[Rule] = []
        for name in scenes:
            say(f"{name}: map and viewpoints")
            case = scene_case(name, views=4 if quick else 12, seed=seed)
            rules += [*raster_rules(case), *lidar_rules(case), radar_rule(case)]
        rules.append(contact_rule(4.0 if quick else 12.0))
        for rule in rules:
            say(f"{rule.case}: {rule.name}")
            took, share = compare(rule, turns=2 if quick else 4)
            differing += share > 0.0
            details = {"saved": 1.0 - took[True] / took[False], "outputs_that_differ": share}
            result.rows.append(Row(f"{rule.case}: {rule.name}", "on", share, "outputs differ", took[True], details))
            result.rows.append(Row(f"{rule.case}: {rule.name}", "off", 0.0, "outputs differ", took[False]))
    if quick:
        result.left_out.append(f"the scenes {', '.join(SCENES[1:])}; two thirds of the viewpoints")
    result.left_out.append(
        "sensors without a consumer: left out of the wiring, never built (tests/unit/test_stages.py)"
    )
    result.checks.append(
        Check("rules whose outputs differ with and without them", float(differing), "<=", 0.0, "rules")
    )
    return result


def compare(rule: Rule, *, turns: int) -> tuple[dict[bool, float], float]:
    """Seconds of all outputs, on and off, and the share of outputs that differ."""
    best: dict[bool, NDArray[np.float64]] = {}
    share = 0.0
    for turn in range(turns):
        outputs: dict[bool, list[Outputs]] = {}
        for on in (True, False):
            ran = list(rule.run(on))
            times = np.array([seconds for seconds, _ in ran])
            best[on] = np.minimum(best.get(on, times), times)
            outputs[on] = [made for _, made in ran]
        if turn == 0:
            pairs = list(zip(outputs[True], outputs[False], strict=True))
            share = float(np.mean([not _same(a, b) for a, b in pairs]))
    return {on: float(times.sum()) for on, times in best.items()}, share


def _same(a: Mapping[str, NDArray[Any]], b: Mapping[str, NDArray[Any]]) -> bool:
    """Bit for bit; NaN is like NaN, +0 unlike -0."""
    return a.keys() == b.keys() and all(
        a[k].shape == b[k].shape and a[k].dtype == b[k].dtype and a[k].tobytes() == b[k].tobytes() for k in a
    )


def raster_rules(case: Case, camera: CameraModel | None = None) -> list[Rule]:
    """The rules of the raster in one scene."""
    seen = camera if camera is not None else CameraModel.from_fov(320, 240, 90.0)
    rules = []
    for field in dataclasses.fields(RenderSkips):
        if field.name == _POSED:
            continue
        rules.append(Rule(field.name.replace("_", " "), case.name, _pictures(case, seen, field.name)))
    rules.append(Rule("channels without a consumer", case.name, _channels(case, seen)))
    rules.append(Rule("actors out of view", case.name, _actors(case, seen)))
    return rules


def _pictures(case: Case, camera: CameraModel, field: str) -> Callable[[bool], Iterator[tuple[float, Outputs]]]:
    def run(on: bool) -> Iterator[tuple[float, Outputs]]:
        geometry = FrameGeometry(case.world)
        skips = dataclasses.replace(RenderSkips(), **{field: on})
        renderer = FrameRenderer(geometry, camera, shadows=True, skips=skips)
        for view in _warm(case.views):
            geometry.pose(view.t_ns)
            out = buffers(camera, _COLOUR)
            began = time.perf_counter()
            renderer.render(view.pose, out)
            yield time.perf_counter() - began, out

    return _without_first(run)


def _channels(case: Case, camera: CameraModel) -> Callable[[bool], Iterator[tuple[float, Outputs]]]:
    def run(on: bool) -> Iterator[tuple[float, Outputs]]:
        geometry = FrameGeometry(case.world)
        renderer = FrameRenderer(geometry, camera, shadows=True)
        for view in _warm(case.views):
            geometry.pose(view.t_ns)
            out = buffers(camera, ("depth", "instance") if on else tuple(CHANNELS))
            began = time.perf_counter()
            renderer.render(view.pose, out)
            yield time.perf_counter() - began, {name: out[name] for name in ("depth", "instance")}

    return _without_first(run)


def _actors(case: Case, camera: CameraModel) -> Callable[[bool], Iterator[tuple[float, Outputs]]]:
    """Posing and drawing, since posing is what is saved. Without shadows: those of actors out of view can be in it."""

    def run(on: bool) -> Iterator[tuple[float, Outputs]]:
        geometry = FrameGeometry(case.world)
        renderer = FrameRenderer(geometry, camera, skips=RenderSkips(unseen_actors=on))
        for view in _warm(case.views):
            out = buffers(camera, tuple(CHANNELS))
            began = time.perf_counter()
            geometry.expect(view.t_ns)
            renderer.render(view.pose, out)
            yield time.perf_counter() - began, out

    return _without_first(run)


def lidar_rules(case: Case) -> list[Rule]:
    """The rules of rays in one scene, by the caster's own switches."""
    azimuth, elevation = np.meshgrid(
        np.linspace(-np.pi, np.pi, 900, endpoint=False), np.deg2rad(np.linspace(-15, 15, 16))
    )
    level = np.cos(elevation)
    rays = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)

    def sweeps(*, max_range: bool = True, tree: bool = True) -> Iterator[tuple[float, Outputs]]:
        geometry = FrameGeometry(case.world)
        caster = RayCaster(geometry.native)
        for view in case.views:
            geometry.pose(view.t_ns)
            origins = np.tile(np.array(view.pose.p_WC), (len(rays), 1))
            range_m, geom, normal = np.empty(len(rays)), np.empty(len(rays), np.int32), np.empty((len(rays), 3))
            began = time.perf_counter()
            caster.cast(origins, rays, 0.0, _LIDAR_RANGE_M, range_m, geom, normal, tree=tree, max_range=max_range)
            yield time.perf_counter() - began, {"range": range_m, "geom": geom, "normal": normal}

    return [
        Rule("LiDAR: beyond its range", case.name, lambda on: sweeps(max_range=on)),
        Rule("LiDAR: tree over the geometry", case.name, lambda on: sweeps(tree=on)),
    ]


def radar_rule(case: Case) -> Rule:
    """The rule of a radar in one scene."""
    return Rule("radar: outputs without a consumer", case.name, unread_outputs(case))


def contact_rule(seconds: float) -> Rule:
    """Takes off in the village, hovers, and comes down until it stands again; all of the state at every tick."""

    def run(on: bool) -> Iterator[tuple[float, Outputs]]:
        vehicle = load_vehicle("x500")
        physics = QuadrotorPhysics(vehicle, load_scene("training_village"), 4_000_000, contact_skipping=on)
        ticks = round(seconds * 250)
        flight = []
        standing_m = float(physics.state[2])
        top_m = standing_m + 0.2 * seconds
        height_m, climb_mps = standing_m, 0.0
        began = time.perf_counter()
        for tick in range(ticks):
            part = tick / ticks
            wanted_m = top_m if part < 0.6 else standing_m - 1.0
            # A climb or sink of 1 m/s at most; at the end the rotors stop.
            thrust = 1.0 + 0.5 * min(max(wanted_m - height_m, -1.0), 1.0) - 0.5 * climb_mps
            control = vehicle.hover_control * min(max(thrust, 0.6), 1.4) * (part < 0.9)
            state = physics.advance(tick, (control,) * len(vehicle.rotors))
            height_m, climb_mps = state.p_WB[2], state.v_WB_W[2]
            flight.append(state)
        took = time.perf_counter() - began
        yield took, {name: np.array([getattr(state, name) for state in flight]) for name in TruthState._fields}

    return Rule("contact work", "flight in training_village", run)


def _warm(views: Sequence[View]) -> Iterator[View]:
    """The last view first, so that no picture is the first one."""
    yield views[-1]
    yield from views


def _without_first(
    run: Callable[[bool], Iterator[tuple[float, Outputs]]],
) -> Callable[[bool], Iterator[tuple[float, Outputs]]]:
    def rest(on: bool) -> Iterator[tuple[float, Outputs]]:
        pictures = run(on)
        next(pictures)
        return pictures

    return rest


def plot(result: BenchmarkResult, title: str, path: Path) -> None:
    """Time with each rule as a share of the time without it."""
    from matplotlib.figure import Figure  # slow to import, and only needed here

    rows = [row for row in result.rows if row.method == "on"]
    figure = Figure(figsize=(9.0, 1.2 + 0.3 * len(rows)), layout="constrained")
    ax = figure.subplots()
    shares = [1.0 - row.details["saved"] for row in rows]
    bars = ax.barh([row.case for row in rows], shares, color="#4477aa")
    ax.bar_label(bars, [f"{100 * row.details['saved']:.0f} % saved" for row in rows], padding=4, fontsize=8)
    ax.axvline(1.0, color="#888888", linewidth=0.8)
    ax.invert_yaxis()
    ax.set_xlim(0.0, 1.25 * max([1.0, *shares]))
    ax.set_xlabel("time with the rule over time without it")
    ax.set_title(title, loc="left", fontweight="bold")
    save_figure(figure, path)
