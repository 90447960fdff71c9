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
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.bench_suite.lidar import pattern_rays
from hil.bench_suite.raster import buffers
from hil.bench_suite.raster_cases import SCENES, Case, View, scene_case
from hil.bench_suite.result import BenchmarkResult, Check, Row
from hil.bench_suite.timing import one_core
from hil.signals.samples import RadarSample, TruthState
from hil.view_points import pose_of
from sim._kernels import RayCaster
from sim.frame.camera_model import CameraModel
from sim.frame.channels import CHANNELS
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer, RenderSkips
from sim.frame.source import SharedFrames
from sim.physics.quadrotor import QuadrotorPhysics
from sim.physics.vehicle import load_vehicle
from sim.scene.scene import load_scene
from sim.scene.view_point import ViewPoint
from sim.sensors.catalog import make_sensor

Say = Callable[[str], None]
Outputs = dict[str, NDArray[Any]]
Run = Callable[[bool], Iterator[tuple[float, Outputs]]]
_COLOUR = ("rgb", "depth", "segmentation")
_POSED = "unseen_actors"  # a field of RenderSkips that saves posing: measured with it
_LIDAR_RANGE_M = 50.0
_RADAR = "bgt60tr13c"
_TICK_NS = 4_000_000


@dataclass(frozen=True)
class Rule:
    """`run(on)` yields once for each output: seconds that it took, and the output as it must be on or off."""

    name: str
    case: str
    run: Run


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
        if field.name != _POSED:
            pictures = _pictures(case, seen, skips=partial(_one_rule, field.name))
            rules.append(Rule(field.name.replace("_", " "), case.name, pictures))
    consumed, everything = ("depth", "instance"), tuple(CHANNELS)
    pictures = _pictures(case, seen, channels=lambda on: consumed if on else everything, compared=consumed)
    rules.append(Rule("channels without a consumer", case.name, pictures))
    # Posing is what is saved, so it is timed too. Without shadows: those of actors out of view can be in the picture.
    pictures = _pictures(
        case,
        seen,
        channels=lambda _: everything,
        compared=everything,
        skips=lambda on: RenderSkips(unseen_actors=on),
        shadows=False,
        posing=True,
    )
    rules.append(Rule("actors out of view", case.name, pictures))
    return rules


def _one_rule(name: str, on: bool) -> RenderSkips:
    return RenderSkips(**{name: on})


def _pictures(
    case: Case,
    camera: CameraModel,
    *,
    channels: Callable[[bool], Sequence[str]] = lambda _: _COLOUR,
    compared: Sequence[str] = _COLOUR,
    skips: Callable[[bool], RenderSkips] = lambda _: RenderSkips(),
    shadows: bool = True,
    posing: bool = False,
) -> Run:
    """Pictures of all views; with `posing` its time is in theirs. `channels`, `skips`: with the rule on or off."""

    def run(on: bool) -> Iterator[tuple[float, Outputs]]:
        geometry = FrameGeometry(case.world)
        renderer = FrameRenderer(geometry, camera, shadows=shadows, skips=skips(on))
        for i, view in enumerate((case.views[-1], *case.views)):
            out = buffers(camera, channels(on))
            if not posing:
                geometry.pose(view.t_ns)
            began = time.perf_counter()
            if posing:
                geometry.expect(view.t_ns)
            renderer.render(view.pose, out)
            took = time.perf_counter() - began
            if i > 0:  # no picture is the first one
                yield took, {name: out[name] for name in compared}

    return run


def lidar_rules(case: Case) -> list[Rule]:
    """The rules of rays in one scene, by the caster's own switches."""
    rays = pattern_rays("16x900").directions_W

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
    """The whole sensor, drawing included: asked for raw frames alone, and for all that it has.

    Dropping the weakest echoes has no rule here: it changes frames, within the tolerance, and in pictures of the scenes
    no echo is weak enough for it.
    """
    scene = load_scene(case.name)
    truths = sorted((_truth(view) for view in case.views), key=lambda truth: truth.t_ns)

    def run(on: bool) -> Iterator[tuple[float, Outputs]]:
        overrides = {"outputs": ["raw"]} if on else {}
        frames = SharedFrames(case.world)
        radar = make_sensor(
            "radar", preset=_RADAR, rate_hz=10.0, seed=1, scene=scene, step_ns=_TICK_NS, overrides=overrides,
            frames=frames,
        )  # fmt: skip
        radar.sample(truths[-1]._replace(t_ns=0), 0)
        for seq, truth in enumerate(truths, start=1):
            began = time.perf_counter()
            sample = radar.sample(truth, seq)
            took = time.perf_counter() - began
            assert isinstance(sample, RadarSample)
            yield took, {"raw": sample.channels["raw"]}
        frames.close()

    return Rule("radar: outputs without a consumer", case.name, run)


def _truth(view: View) -> TruthState:
    """A vehicle that stands where the view is from, and looks as it does but for its roll."""
    x, y, z = view.pose.R_WC[2::3]
    look_deg = (math.degrees(math.atan2(y, x)), math.degrees(math.atan2(-z, math.hypot(x, y))))
    return pose_of(ViewPoint(name="view", at_m=view.pose.p_WC, look_deg=look_deg))._replace(t_ns=view.t_ns)


def contact_rule(seconds: float) -> Rule:
    """Takes off in the village, hovers, and comes down until it stands again; all of the state at every tick."""

    def run(on: bool) -> Iterator[tuple[float, Outputs]]:
        vehicle = load_vehicle("x500")
        physics = QuadrotorPhysics(vehicle, load_scene("training_village"), _TICK_NS, contact_skipping=on)
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
