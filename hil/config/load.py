"""From files and command line to a checked bench.

Settings lie over one another in this order, the later winning: defaults, the rig's file, the bench file, the
command line's options, its `--set`s. Mappings merge key by key; everything else replaces. Every problem of every
layer is reported at once, and each where it was written.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pydantic

from hil.config import radar_checks
from hil.config.cross_checks import cross_checks, vehicle_checks
from hil.config.files import available, default_bench, find, is_bare
from hil.config.layers import Settings, lay_settings, parse_setting
from hil.config.scenes import read_scene, save_scene, world_problems
from hil.config.schema import STANDARD_SENSORS, BenchConfig
from hil.config.sensors import FLIGHT_KINDS, resolve_sensors
from hil.missions import Geopoint, Mission, load_mission
from hil.missions.script import MissionScript
from hil.missions.script_file import bench_problems, is_script, lay_script, mission_problems, read_script, with_gusts
from hil.signals.documents.document import Document, shown_path
from hil.signals.documents.validate import COMMAND_LINE, at, nearest, shown, validate
from hil.signals.documents.yaml_lines import dump_yaml, read_yaml
from hil.signals.errors import ConfigError, Problem
from sim.physics.vehicle import Vehicle
from sim.randomize.looks import drawn, in_weather, randomized
from sim.randomize.noise import noise_factor, with_noise
from sim.scene.scene import Scene
from sim.scene.world import World, load_world
from sim.sensors.catalog import KINDS

MAX_PROBLEMS = 100


@dataclass(frozen=True)
class Bench:
    """A bench that has been checked: its settings, and what the files they name hold.

    `files` says which file each part came from: 'bench', 'rig', 'vehicle', 'scene', 'mission', as far as there is one,
    and 'plan' where the mission is a script that flies one.
    """

    config: BenchConfig
    vehicle: Vehicle
    scene: Scene
    mission: Mission | None
    files: Mapping[str, Path]
    script: MissionScript | None = None

    def sensor_parameters(self, name: str) -> Any:
        """The parameters that a sensor is made with: those of the bench, with the noise that its seed gives it."""
        return noisy_parameters(self.config, name)

    def drawn(self) -> dict[str, Any] | None:
        """What `randomize` drew, as data; None where it is off."""
        return drawn_of(self.config, self.scene)

    @property
    def world(self) -> World:
        """The scene as geometry; made at the first call and kept."""
        return load_world(self.scene)


def load_bench(
    path: Path | str | None = None,
    *,
    rig: str | None = None,
    scene: str | None = None,
    mission: str | None = None,
    seed: int | None = None,
    settings: Sequence[str] = (),
) -> Bench:
    """Read, merge and check everything a bench consists of.

    `path` is the bench file; None means ./hil.yaml or, where there is none, the one that came with the
    installation. `settings` are the texts of `--set`. Raises ConfigError with every problem found.
    """
    options = {"rig": rig, "scene": scene, "mission": mission, "seed": seed}
    given = {key: value for key, value in options.items() if value is not None}
    try:
        return _Loading(path, given, settings).bench()
    except ConfigError as error:
        raise ConfigError(_readable(error.problems)) from None


def _readable(problems: list[Problem]) -> list[Problem]:
    """As many as a person reads, and how many there are besides."""
    more = len(problems) - MAX_PROBLEMS
    if more <= 0:
        return problems
    return [*problems[:MAX_PROBLEMS], Problem("and", f"{more} more problems")]


class _Loading:
    """One load on its way: what was merged so far, which files were read, what was wrong."""

    def __init__(self, path: Path | str | None, options: Mapping[str, Any], settings: Sequence[str]) -> None:
        self.problems: list[Problem] = []
        self.files: dict[str, Path] = {}
        self.settings = Settings()
        bench_path = Path(path) if path is not None else default_bench()
        document = Document("defaults", {})
        if bench_path is not None:
            document = read_yaml(bench_path)
            self.files["bench"] = bench_path
        if not isinstance(document.data, dict):
            message = f"must be a mapping of keys, not {shown(document.data)}"
            raise ConfigError([at(document, (), message)])
        self.complete = self._take_complete(document)
        self.beside = [bench_path.parent] if bench_path is not None else []
        rig = self._rig(document, options, settings)
        if "sensors" not in document.data and (rig is None or "sensors" not in rig.data):
            self.settings.put(("sensors",), STANDARD_SENSORS, "defaults")
        if rig is not None:
            self.settings.lay(rig)
        self.settings.lay(document)
        for key, value in options.items():
            self.settings.put((key,), value, f"--{key}")
        self.problems += lay_settings(self.settings, settings)

    def _take_complete(self, bench: Document) -> bool:
        """Whether the file says everything. `complete` speaks about the file and is no setting of the bench."""
        complete = bench.data.pop("complete", False)
        if not isinstance(complete, bool):
            self.problems.append(at(bench, ("complete",), f"must be true or false, not {shown(complete)}"))
        return complete is True

    def _rig(self, bench: Document, options: Mapping[str, Any], settings: Sequence[str]) -> Document | None:
        """The rig's file, chosen by --set rig=, --rig, the bench file or the default, in this order."""
        if self.complete:
            if "rig" in options:
                message = "cannot change the rig of a file that says everything"
                self.problems.append(Problem("--rig", message, 'remove "complete: true" from the file'))
            return None
        choice = Settings()
        choice.put(("rig",), BenchConfig.model_fields["rig"].default, "defaults")
        if "rig" in bench.data:
            choice.put(("rig",), bench.data["rig"], bench.where(("rig",)))
        if "rig" in options:
            choice.put(("rig",), options["rig"], "--rig")
        for text in settings:
            if text.partition("=")[0].strip() == "rig":
                try:
                    _, value, origin = parse_setting(text)
                except ConfigError:
                    continue  # said where the settings are laid
                choice.put(("rig",), value, origin)
        path = self._file("rig", choice.data["rig"], choice)
        if path is None:
            return None
        document = self._read("rig", path)
        if document is None:
            return None
        if not isinstance(document.data, dict):
            self.problems.append(at(document, (), f"must be a mapping of keys, not {shown(document.data)}"))
            return None
        for key in ("rig", "complete"):
            if key in document.data:
                self.problems.append(at(document, (key,), "does not belong into a rig's file"))
        keep = {key: value for key, value in document.data.items() if key not in ("rig", "complete")}
        return Document(document.source, keep, document.lines)

    def _file(self, what: str, name: Any, located: Settings) -> Path | None:
        """Find the file that a setting names, or note why there is none."""
        if not isinstance(name, str):
            return None  # checked, and said, with the rest of the settings
        path = find(what, name, self.beside) if name.strip() else None
        if path is None:
            if is_bare(what, name):
                hint = nearest(name, available(what, self.beside))
                self.problems.append(at(located, (what,), f"is unknown: {name!r}", hint))
            else:
                places = [shown_path(folder) for folder in (*self.beside, Path())]
                looked = "looked beside " + " and in ".join(dict.fromkeys(places)) + " and in the installed rigs"
                self.problems.append(at(located, (what,), f"names a file that does not exist: {name}", looked))
            return None
        self.files[what] = path
        return path

    def _read(self, what: str, path: Path) -> Document | None:
        try:
            return read_yaml(path)
        except ConfigError as error:
            self.problems += error.problems
            self.files.pop(what, None)
            return None

    def _vehicle(self) -> Vehicle | None:
        name = self.settings.data.get("vehicle", BenchConfig.model_fields["vehicle"].default)
        path = self._file("vehicle", name, self.settings)
        document = self._read("vehicle", path) if path is not None else None
        if document is None:
            return None
        vehicle, problems = validate(Vehicle, document.data, document)
        self.problems += problems
        return vehicle

    def _scene(self, vehicle: Vehicle | None, config: BenchConfig | None) -> Scene | None:
        """Load the scene's file and what it names, with the bench's seed of the map, weather and looks laid over it."""
        name = self.settings.data.get("scene", BenchConfig.model_fields["scene"].default)
        path = self._file("scene", name, self.settings)
        if path is None:
            return None
        try:
            scene, problems = read_scene(path)
        except ConfigError as error:
            self.problems += error.problems
            self.files.pop("scene", None)
            return None
        self.problems += problems
        seed = self.settings.data.get("map_seed")
        if scene is not None and type(seed) is int and seed >= 0:
            try:
                scene = scene.with_map_seed(seed)
            except ValueError as error:
                self.problems.append(at(self.settings, ("map_seed",), f"has no meaning: {error}", "leave it out"))
        if scene is not None and config is not None:
            scene = randomized(in_weather(scene, config.weather), config.randomize, config.seed)
        if scene is not None and not problems:
            self.problems += world_problems(scene, vehicle)
        return scene

    def _mission_path(self) -> Path | None:
        name = self.settings.data.get("mission")
        return self._file("mission", name, self.settings) if name is not None else None

    def _script(self, path: Path | None) -> MissionScript | None:
        """The mission, where it is a script: its limits and faults are laid over the settings."""
        if path is None or not is_script(path):
            return None
        try:
            script = read_script(path)
        except ConfigError as error:
            self.problems += error.problems
            return None
        if script.plan_path is not None:
            self.files["plan"] = script.plan_path
        if not self.complete:  # else the file says them already
            lay_script(self.settings, script)
        return script

    def _mission(self, path: Path | None, scene: Scene | None) -> Mission | None:
        if path is None:
            return None
        try:
            return load_mission(path, site=site_of(scene) if scene is not None else None)
        except ConfigError as error:
            self.problems += error.problems
            return None

    def bench(self) -> Bench:
        mission_path = self._mission_path()
        script = self._script(mission_path)
        data = dict(self.settings.data)
        section = data.pop("sensors", {})
        config, wrong = validate(BenchConfig, data, self.settings)
        tick_hz = (config or BenchConfig()).tick_hz
        sensors, problems = resolve_sensors(section, self.settings, tick_hz=tick_hz)
        self.problems += wrong + problems
        if config is not None:
            config = config.model_copy(update={"sensors": sensors})
            self.problems += cross_checks(config, self.settings) + noise_problems(config, self.settings)
            if config.companion.on or config.companion.control:
                from hil.config.companion_checks import companion_problems  # loads ZeroMQ

                self.problems += companion_problems(config, self.settings, scripted=script is not None)
        vehicle = self._vehicle()
        if config is not None and vehicle is not None:
            self.problems += vehicle_checks(config, vehicle, self.settings)
        scene = self._scene(vehicle, config)
        if mission_path is not None and is_script(mission_path):
            mission_path = script.plan_path if script is not None else None
        if config is not None and scene is not None and not self.problems:
            self.problems += radar_checks.world_problems(config, scene, self.settings)
        mission = self._mission(mission_path, scene)
        if script is not None:
            self.problems += mission_problems(script, mission)
            if config is not None and vehicle is not None:
                types = {name: KINDS[sensor.kind].sample_type for name, sensor in config.sensors.items()}
                self.problems += bench_problems(script, sensors=types, rotors=len(vehicle.rotors))
            if config is not None and scene is not None and not self.complete:
                config = config.model_copy(update={"wind": with_gusts(config.wind, scene.wind_W_mps, script)})
        if config is not None and mission is not None and not problems:
            fed = config.autopilot_sensors()
            missing = [kind for kind in FLIGHT_KINDS if kind not in fed]
            if missing:
                message = f"must hold a {' and a '.join(missing)} that feeds the flight controller: it flies a mission"
                self.problems.append(at(self.settings, ("sensors",), message))
        if self.problems or config is None or vehicle is None or scene is None:
            raise ConfigError(_in_order(self.problems))
        return Bench(config, vehicle, scene, mission, self.files, script)


def site_of(scene: Scene) -> Geopoint:
    """Where the scene's origin stands."""
    return Geopoint(scene.site.latitude_deg, scene.site.longitude_deg, scene.site.altitude_m)


def _in_order(problems: list[Problem]) -> list[Problem]:
    """By file in order of first appearance, then by line, the command line's last; no problem twice."""
    files: dict[str, int] = {}
    keyed: dict[str, tuple[tuple[bool, int, int], Problem]] = {}
    for problem in problems:
        source, _, line = problem.where.rpartition(":")
        if not line.isdigit():
            source, line = problem.where, "0"
        order = files.setdefault(source, len(files))
        keyed.setdefault(str(problem), ((source.startswith(COMMAND_LINE), order, int(line)), problem))
    return [problem for _, problem in sorted(keyed.values(), key=lambda pair: pair[0])]


def resolved_yaml(config: BenchConfig) -> str:
    """The whole configuration as a bench file that says everything: loading it gives the same `BenchConfig` again."""
    data = config.model_dump(mode="json", exclude={"sensors"})
    data["complete"] = True
    data["sensors"] = {
        name: {
            "kind": sensor.kind,
            **({"preset": sensor.preset} if sensor.preset is not None else {}),
            "autopilot": sensor.autopilot,
            "rate_hz": sensor.rate_hz,
            **sensor.parameters.model_dump(mode="json"),
        }
        for name, sensor in config.sensors.items()
    }
    head = "# Complete settings of one run; no rig file is laid under them.\n"
    return head + dump_yaml(data)


def save_bench(bench: Bench, folder: Path) -> Path:
    """Put the bench into a folder so that it can be loaded from there for ever: bench.yaml with everything in it,
    and copies of the vehicle, the scene with its map, the mission and a script's plan. Returns the path of bench.yaml.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names: dict[str, str] = {}
    if "scene" in bench.files:
        names["scene"] = save_scene(bench.scene, bench.files["scene"], folder)
    for what in ("vehicle", "mission"):
        if what in bench.files:
            source = bench.files[what]
            names[what] = f"{what}{source.suffix}"
            (folder / names[what]).write_bytes(source.read_bytes())
    if "plan" in bench.files:  # a script finds its plan by name beside itself
        (folder / bench.files["plan"].name).write_bytes(bench.files["plan"].read_bytes())
    path = folder / "bench.yaml"
    text = resolved_yaml(bench.config.model_copy(update=names))
    temporary = path.with_suffix(".part")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)
    return path


def noise_factors(config: BenchConfig) -> dict[str, float]:
    """By what the errors of each sensor are multiplied; nothing for those that stay as they are."""
    limits, seed = config.randomize.noise, config.randomize.seed
    if limits is None:
        return {}
    seed = config.seed if seed is None else seed
    factors = {name: noise_factor(limits, seed, sensor.kind, name) for name, sensor in config.sensors.items()}
    return {name: factor for name, factor in factors.items() if factor is not None}


def noisy_parameters(config: BenchConfig, name: str) -> Any:
    """Parameters of a sensor with its own factor of noise."""
    sensor = config.sensors[name]
    factor = noise_factors(config).get(name)
    return sensor.parameters if factor is None else with_noise(sensor.kind, sensor.parameters, factor)


def noise_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Sensors that the drawn factor takes beyond what their errors may be."""
    problems = []
    for name, factor in noise_factors(config).items():
        try:
            noisy_parameters(config, name)
        except pydantic.ValidationError as error:
            item = error.errors(include_url=False)[0]
            where = ".".join(map(str, item["loc"]))
            message = f"makes the errors of {name!r} {factor:.3g} times as large, and {where} is then out of its range"
            problems.append(at(settings, ("randomize", "noise"), message, "narrow the limits of its kind"))
    return problems


def drawn_of(config: BenchConfig, scene: Scene) -> dict[str, Any] | None:
    """Everything that was drawn; None where nothing is switched on."""
    told = drawn(scene, config.randomize)
    if told is not None and config.randomize.noise is not None:
        told["noise"] = noise_factors(config)
    return told
