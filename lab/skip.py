"""`hil bench skip`: time saved by each skipping rule, and whether the rule changes an output.

A rule leaves out work that cannot affect the outputs. Each rule is switched off alone, and the outputs with and without
it are compared bit for bit. The table has the times with and without it. Only the rule for the backs of meshes may
change a value: on outlines, where front and back of a fine mesh are closer than the rounding of their distances.

    raster    each field of RenderSkips; channels without a consumer; posing of actors out of view
    LiDAR     geometry beyond the greatest range; geometry that the bounding tree excludes
    radar     maps, points and tracks if only raw frames are requested
    physics   contact work while nothing can touch

The raster's rules are measured with colour, depth, segmentation and shadows at 320 x 240, over random viewpoints; each
picture follows one of another time and place. Times are for one thread: the best of several rounds, each with the rule
on and off.
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

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.sensors.raster import buffers
from hil.apps.bench_suite.sensors.raster_cases import SCENES, Case, View, scene_case
from hil.apps.bench_suite.timing import one_core
from hil.apps.view.points import pose_of
from lab.lidar import pattern_rays
from signals.channels import CHANNELS
from signals.samples import RadarSample, TruthState
from sim._kernels import RayCaster
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import Execution, FrameRenderer, RenderSkips
from sim.frame.source import SharedFrames
from sim.physics import multirotor
from sim.physics.integration import Integration
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.scene.view_point import ViewPoint
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation

TITLE = "Skipping: time saved by each rule"
Outputs = dict[str, NDArray[Any]]
Run = Callable[[bool], Iterator[tuple[float, Outputs]]]
_COLOUR = ("rgb", "depth", "segmentation")
_POSING_RULE = "unseen_actors"  # the field of RenderSkips that saves posing: its time includes posing
_LIDAR_RANGE_M = 50.0
_RADAR = "bgt60tr13c"
_TICK_NS = 4_000_000
_BACKS_MAY_DIFFER = 5e-6  # share of values; measured: at most 2.2e-6 in one scene


@dataclass(frozen=True)
class Rule:
    """One skipping rule. `run(on)` yields the time [s] and the arrays of each output, with the rule on or off."""

    name: str
    case: str
    run: Run
    may_differ: float = 0.0  # share of the values


def measure(*, quick: bool, status: ShowStatus, errors_only: bool = False, seed: int = 1) -> BenchmarkResult:
    """Measure every rule on and off; `seed` selects the viewpoints."""
    result = BenchmarkResult(time_label="wall time [s]")
    scenes = SCENES[:1] if quick else SCENES
    differing = 0
    with one_core():
        rules: list[Rule] = []
        for name in scenes:
            status(f"{name}: map and viewpoints")
            case = scene_case(name, views=4 if quick else 12, seed=seed)
            rules += [*raster_rules(case), *lidar_rules(case), radar_rule(case)]
        rules.append(contact_rule(4.0 if quick else 12.0))
        for rule in rules:
            status(f"{rule.case}: {rule.name}")
            times_s, share = compare(rule, rounds=1 if errors_only else 2 if quick else 4)
            differing += share > rule.may_differ
            details = {"saved": 1.0 - times_s[True] / times_s[False], "values_that_differ": share}
            result.rows.append(Row(f"{rule.case}: {rule.name}", "on", share, "values differ", times_s[True], details))
            result.rows.append(Row(f"{rule.case}: {rule.name}", "off", 0.0, "values differ", times_s[False]))
    if quick:
        result.left_out.append(f"the scenes {', '.join(SCENES[1:])}; two thirds of the viewpoints")
    result.left_out.append(
        "sensors without a consumer: never made, so there is no time to save (tests/unit/hil/run/loop/test_stages.py)"
    )
    result.checks.append(
        Check("rules whose outputs differ with and without them", float(differing), "<=", 0.0, "rules")
    )
    return result


def compare(rule: Rule, *, rounds: int) -> tuple[dict[bool, float], float]:
    """Return the seconds for all outputs with the rule on and off, and the share of values that differ."""
    best: dict[bool, NDArray[np.float64]] = {}
    share = 0.0
    for k in range(rounds):
        outputs: dict[bool, list[Outputs]] = {}
        for on in (True, False):
            timed_outputs = list(rule.run(on))
            times = np.array([seconds for seconds, _ in timed_outputs])
            best[on] = np.minimum(best.get(on, times), times)
            outputs[on] = [output for _, output in timed_outputs]
        if k == 0:
            pairs = list(zip(outputs[True], outputs[False], strict=True))
            share = float(np.mean([_share_that_differs(a, b) for a, b in pairs]))
    return {on: float(times.sum()) for on, times in best.items()}, share


def _share_that_differs(a: Mapping[str, NDArray[Any]], b: Mapping[str, NDArray[Any]]) -> float:
    """Return the share of values whose bits differ: 0 without values, 1 if names, shapes or types differ."""
    if a.keys() != b.keys() or any((a[k].shape, a[k].dtype) != (b[k].shape, b[k].dtype) for k in a):
        return 1.0
    differing = sum(int((_bits(a[k]) != _bits(b[k])).any(axis=1).sum()) for k in a)
    return differing / max(sum(values.size for values in a.values()), 1)


def _bits(values: NDArray[Any]) -> NDArray[np.uint8]:
    """Return the bytes of each value, one row a value."""
    return np.frombuffer(values.tobytes(), np.uint8).reshape(values.size, values.itemsize)


def raster_rules(case: Case, camera: CameraModel | None = None) -> list[Rule]:
    """Return the rules of the raster in one scene."""
    model = camera if camera is not None else CameraModel.from_fov(320, 240, 90.0)
    rules = []
    for field in dataclasses.fields(RenderSkips):
        if field.name != _POSING_RULE:
            pictures = _pictures(case, model, skips=partial(_skips_with_rule, field.name))
            may_differ = _BACKS_MAY_DIFFER if field.name == "mesh_backs" else 0.0
            rules.append(Rule(field.name.replace("_", " "), case.name, pictures, may_differ))
    consumed, all_channels = ("depth", "instance"), tuple(CHANNELS)
    pictures = _pictures(case, model, channels=lambda on: consumed if on else all_channels, compared=consumed)
    rules.append(Rule("channels without a consumer", case.name, pictures))
    # The rule saves posing, so posing is timed too. Shadows are off: those of actors out of view can be visible.
    pictures = _pictures(
        case,
        model,
        channels=lambda _: all_channels,
        compared=all_channels,
        skips=lambda on: RenderSkips(unseen_actors=on),
        shadows=False,
        posing=True,
    )
    rules.append(Rule("actors out of view", case.name, pictures))
    return rules


def _skips_with_rule(name: str, on: bool) -> RenderSkips:
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
    """Return a run that renders all views; with `posing` the time includes posing.

    `channels` and `skips` give the settings with the rule on or off; `compared` names the compared channels.
    """

    def run(on: bool) -> Iterator[tuple[float, Outputs]]:
        geometry = FrameGeometry(case.world)
        renderer = FrameRenderer(geometry, camera, shadows=shadows, execution=Execution(skips=skips(on)))
        for i, view in enumerate((case.views[-1], *case.views)):
            out = buffers(camera, channels(on))
            if not posing:
                geometry.pose(view.t_ns)
            began = time.perf_counter()
            if posing:
                geometry.expect(view.t_ns)
            renderer.render(view.pose, out)
            took = time.perf_counter() - began
            if i > 0:  # the first picture is not measured
                yield took, {name: out[name] for name in compared}

    return run


def lidar_rules(case: Case) -> list[Rule]:
    """Return the rules of ray casting in one scene."""
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
        Rule("LiDAR: geometry beyond its range", case.name, lambda on: sweeps(max_range=on)),
        Rule("LiDAR: tree over the geometry", case.name, lambda on: sweeps(tree=on)),
    ]


def radar_rule(case: Case) -> Rule:
    """Return the rule that only raw frames are made if nothing else is requested; times include rendering.

    The dropping of the weakest echoes is not measured: it changes frames (within the tolerance), and no echo in these
    scenes is weak enough.
    """
    scene = load_scene(case.name)
    truths = sorted((_truth(view) for view in case.views), key=lambda truth: truth.t_ns)

    def run(on: bool) -> Iterator[tuple[float, Outputs]]:
        overrides = {"outputs": ["raw"]} if on else {}
        frames = SharedFrames(case.world)
        radar = make_sensor(
            Installation("radar", rate_hz=10.0, seed=1, scene=scene, step_ns=_TICK_NS, frames=frames),
            preset=_RADAR,
            overrides=overrides,
        )
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
    """Return the true state of a vehicle at rest that looks along a view, without roll."""
    x, y, z = view.pose.R_WC[2::3]
    look_deg = (math.degrees(math.atan2(y, x)), math.degrees(math.atan2(-z, math.hypot(x, y))))
    return pose_of(ViewPoint(name="view", at_m=view.pose.p_WC, look_deg=look_deg))._replace(t_ns=view.t_ns)


def contact_rule(seconds: float) -> Rule:
    """Return the rule of contact work, in a flight that takes off, hovers and lands. Outputs: all true states."""

    def run(on: bool) -> Iterator[tuple[float, Outputs]]:
        vehicle = load_vehicle("x500")
        physics = VehiclePhysics(
            vehicle, load_scene("training_village"), _TICK_NS, integration=Integration(contact_skipping=on)
        )
        ticks = round(seconds * 250)
        flight = []
        standing_m = float(physics.state[2])
        top_m = standing_m + 0.2 * seconds
        height_m, climb_mps = standing_m, 0.0
        began = time.perf_counter()
        for tick in range(ticks):
            elapsed = tick / ticks
            wanted_m = top_m if elapsed < 0.6 else standing_m - 1.0
            # Climb and descend at up to 1 m/s; stop the rotors at the end.
            thrust = 1.0 + 0.5 * min(max(wanted_m - height_m, -1.0), 1.0) - 0.5 * climb_mps
            control = multirotor.hover_control(vehicle) * min(max(thrust, 0.6), 1.4) * (elapsed < 0.9)
            state = physics.advance(tick, (control,) * len(vehicle.rotors))
            height_m, climb_mps = state.p_WB[2], state.v_WB_W[2]
            flight.append(state)
        took = time.perf_counter() - began
        yield took, {name: np.array([getattr(state, name) for state in flight]) for name in TruthState._fields}

    return Rule("contact work", "flight in training_village", run)
