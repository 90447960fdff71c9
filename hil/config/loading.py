"""Merges the files and command-line options of one bench, or of one vehicle of it, and validates the result.

Later layers replace earlier ones: defaults, the rig's file, the bench file, command-line options, `--set`. Mappings
merge key by key, everything else is replaced whole. All problems of all layers are reported at once, each with the
place where it was written.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from firmware_bridge.autopilots.catalog import PROFILES
from hil.config.bench import Bench, firmware_for, site_of
from hil.config.checks.autopilot_checks import autopilot_problems, build_problems, set_point_problems
from hil.config.checks.cross_checks import cross_problems, site_problems, vehicle_problems
from hil.config.checks.flight_checks import flight_problems
from hil.config.checks.intake_checks import intake_problems, script_intake_problems
from hil.config.checks.part_settings import resolve_parts, without_unset_limits
from hil.config.checks.rotor_checks import airframe_problems, control_problems
from hil.config.checks.search_checks import missing_object_problems, search_problems
from hil.config.checks.sky_checks import almanac_problems
from hil.config.files import available, find, is_bare
from hil.config.formation import shifted_mission
from hil.config.layers import DEFAULTS, Settings, SettingsPart, merge_options, parse_setting
from hil.config.missions import Mission, load_mission
from hil.config.missions.script import MissionScript
from hil.config.missions.script_file import (
    bench_problems,
    is_script,
    merge_script,
    mission_problems,
    read_script,
    with_gusts,
)
from hil.config.params_file import read_params_file
from hil.config.scenes import on_free_ground, read_scene, world_problems
from hil.config.schema import STANDARD_SENSORS, Autopilot, BenchConfig, Start
from hil.config.sensors import radar_checks
from hil.config.sensors.noise import noise_problems
from hil.config.sensors.resolve import resolve_sensors, sample_types
from hil.config.windsock import with_windsock
from signals.documents.document import Document, shown_path
from signals.documents.validate import COMMAND_LINE, at, nearest, shown, validate
from signals.documents.yaml_lines import read_yaml
from signals.errors import ConfigError, Problem
from sim.physics.vehicle import Vehicle
from sim.randomize.variant import in_weather, randomized
from sim.scene.scene import Scene, has_own_site, is_map_file


class BenchLoading:
    """State of one load: the settings merged so far, the files read, the problems found."""

    def __init__(
        self,
        path: Path | None,
        options: Mapping[str, Any],
        settings: Sequence[str],
        *,
        overlay: SettingsPart | None = None,
        scene: Scene | None = None,
    ) -> None:
        """Read the bench file `path`. `options` are command-line options by key, `settings` the texts of `--set`.

        For one vehicle of a bench with several: `overlay` holds its own settings, and `scene` is the loaded scene.
        """
        self.problems: list[Problem] = []
        self.files: dict[str, Path] = {}
        self.settings = Settings()
        self.path, self.options, self.texts = path, options, settings
        self._shared_scene = scene
        document = Document("defaults", {})
        if path is not None:
            document = read_yaml(path)
            self.files["bench"] = path
        if not isinstance(document.data, dict):
            message = f"must be a mapping of keys, not {shown(document.data)}"
            raise ConfigError([at(document, (), message)])
        self.complete = self._take_complete(document)
        self.beside = [path.parent] if path is not None else []
        layers: list[Document | SettingsPart] = [document]
        if overlay is not None:
            document.data.pop("vehicles", None)
            layers.append(overlay)
        rig = self._rig(layers, options, settings)
        if not self.complete:
            self.settings.set(("sensors",), STANDARD_SENSORS, DEFAULTS)
        if rig is not None:
            self.settings.merge(rig)
        for layer in layers:
            self.settings.merge(layer)
        for key, value in options.items():
            self.settings.set((key,), value, f"--{key}")
        if "mission" not in options and has_own_site(Path(str(options.get("scene", "")))):
            # The bench file's mission is at another place on Earth. A --set mission=... still counts: it comes last.
            self.settings.set(("mission",), None, "--scene")
        scene_name, origin = _of_command_line("scene", options, settings) or ("", "")
        if is_map_file(Path(str(scene_name))):  # the bench file's seed makes the map of its own scene
            self.settings.set(("map_seed",), None, origin)
        self.problems += merge_options(self.settings, settings)

    def _take_complete(self, bench: Document) -> bool:
        """Remove `complete` from the data and return it. It describes the file and is not a setting of the bench."""
        complete = bench.data.pop("complete", False)
        if not isinstance(complete, bool):
            self.problems.append(at(bench, ("complete",), f"must be true or false, not {shown(complete)}"))
        return complete is True

    def _rig(
        self, layers: Sequence[Document | SettingsPart], options: Mapping[str, Any], settings: Sequence[str]
    ) -> Document | None:
        """Read the rig's file: the one of --set rig=, else of --rig, of the last layer with a rig, or the default."""
        if self.complete:
            if "rig" in options:
                message = "cannot change the rig of a file with complete settings"
                self.problems.append(Problem("--rig", message, 'remove "complete: true" from the file'))
            return None
        choice = Settings()
        choice.set(("rig",), BenchConfig.model_fields["rig"].default, DEFAULTS)
        for layer in layers:
            if "rig" in layer.data:
                choice.set(("rig",), layer.data["rig"], layer.where(("rig",)))
        if (chosen := _of_command_line("rig", options, settings)) is not None:
            choice.set(("rig",), *chosen)
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
                self.problems.append(at(document, (key,), "does not belong in a rig's file"))
        keep = {key: value for key, value in document.data.items() if key not in ("rig", "complete")}
        return Document(document.source, keep, document.lines)

    def _file(self, kind: str, name: Any, located: Settings) -> Path | None:
        """Find the file that a setting names. Returns None and reports a problem if there is none."""
        if not isinstance(name, str):
            return None  # reported when all settings are validated
        path = find(kind, name, self.beside) if name.strip() else None
        if path is None:
            if is_bare(kind, name):
                hint = nearest(name, available(kind, self.beside))
                self.problems.append(at(located, (kind,), f"is unknown: {name!r}", hint))
            else:
                folders = (*self.beside, Path())
                if any(os.path.isdir(folder / os.path.expanduser(name)) for folder in folders):
                    self.problems.append(at(located, (kind,), f"names a folder, not a file: {name}"))
                    return None
                places = [shown_path(folder) for folder in folders]
                hint = "looked beside " + " and in ".join(dict.fromkeys(places)) + " and in the installed rigs"
                self.problems.append(at(located, (kind,), f"names a file that does not exist: {name}", hint))
            return None
        self.files[kind] = path
        return path

    def _read(self, kind: str, path: Path) -> Document | None:
        try:
            return read_yaml(path)
        except ConfigError as error:
            self.problems += error.problems
            self.files.pop(kind, None)
            return None

    def _vehicle(self) -> Vehicle | None:
        name = self.settings.data.get("vehicle", BenchConfig.model_fields["vehicle"].default)
        path = self._file("vehicle", name, self.settings)
        document = self._read("vehicle", path) if path is not None else None
        if document is None:
            return None
        located = Settings()
        located.merge(document)
        located.merge(SettingsPart(self.settings, ("vehicle_settings",)))
        vehicle, problems = validate(Vehicle, located.data, located)
        self.problems += problems
        if vehicle is not None and (vehicle.rotors or not problems):  # a list with a wrong value was left out
            self.problems += control_problems(vehicle, located)
        return vehicle

    def _scene(self, vehicle: Vehicle | None, config: BenchConfig | None) -> Scene | None:
        """Load the scene and the files it names, with the map seed, weather and randomisation of the bench applied."""
        name = self.settings.data.get("scene", BenchConfig.model_fields["scene"].default)
        path = self._file("scene", name, self.settings)
        if path is None:
            return None
        if self._shared_scene is not None:
            start = Start() if config is None else config.start
            self.problems += world_problems(self._shared_scene, vehicle, start, self.settings)
            return self._shared_scene
        try:
            scene, problems = read_scene(path)
            starts_at_origin = config is None or config.start.p_W == Start().p_W
            if scene is not None and is_map_file(path) and vehicle is not None and starts_at_origin:
                scene = on_free_ground(scene, vehicle)
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
            scene = with_windsock(scene, scene.wind_W_mps if config.wind is None else config.wind.steady_W_mps)
            scene = randomized(in_weather(scene, config.weather), config.randomize, config.seed)
        if scene is not None and not problems:
            start = Start() if config is None else config.start
            self.problems += world_problems(scene, vehicle, start, self.settings)
        return scene

    def _mission_path(self) -> Path | None:
        name = self.settings.data.get("mission")
        return self._file("mission", name, self.settings) if name is not None else None

    def _script(self, path: Path | None) -> MissionScript | None:
        """Read the mission if it is a script, and merge its limits and faults over the settings."""
        if path is None or not is_script(path):
            return None
        try:
            script = read_script(path)
        except ConfigError as error:
            self.problems += error.problems
            return None
        if script.plan_path is not None:
            self.files["plan"] = script.plan_path
        if not self.complete:  # a complete file already contains them
            merge_script(self.settings, script)
        return script

    def _mission(self, path: Path | None, scene: Scene | None) -> Mission | None:
        if path is None:
            return None
        try:
            return load_mission(path, site=site_of(scene) if scene is not None else None)
        except ConfigError as error:
            self.problems += error.problems
            return None

    def _take_params_file(self) -> None:
        """Put the parameters of `autopilot.params_file` into `autopilot.params_of_file`, without those of a board."""
        section = self.settings.data.get("autopilot")
        name = section.get("params_file") if isinstance(section, dict) else None
        if not isinstance(section, dict) or not isinstance(name, str):
            return
        place = ("autopilot", "params_file")
        path = find("params", name, self.beside)
        profile = PROFILES.get(str(section.get("kind", Autopilot.model_fields["kind"].default)))
        if path is None:
            self.problems.append(at(self.settings, place, f"names a file that does not exist: {name}"))
        elif profile is not None and "params_file" in profile.keys:
            try:
                parameters = read_params_file(path)
            except ConfigError as error:
                self.problems += error.problems
                return
            for parameter in parameters:
                if not profile.firmware.is_of_board(parameter.name):
                    value_place = ("autopilot", "params_of_file", parameter.name)
                    self.settings.set(value_place, parameter.value, parameter.where)
            self.settings.set(place, None, self.settings.where(place))

    def _take_followed_log(self) -> None:
        """Make the paths of `follow` absolute: a saved bench finds them from any folder."""
        section = self.settings.data.get("follow")
        for key in ("log", "columns"):
            name = section.get(key) if isinstance(section, dict) else None
            if not isinstance(name, str):
                continue
            place = ("follow", key)
            folders = (*self.beside, Path()) if self.settings.where(place).rpartition(":")[2].isdigit() else (Path(),)
            found = [path for folder in folders if os.path.exists(path := folder / os.path.expanduser(name))]
            if found:
                self.settings.set(place, str(found[0].resolve()), self.settings.where(place))
            else:
                self.problems.append(at(self.settings, place, f"names a file that does not exist: {name}"))

    def bench(self, *, flown: bool) -> Bench:
        """Build the bench; for one that is `flown`, with what a flight needs. Raises ConfigError with every problem."""
        mission_path = self._mission_path()
        script = self._script(mission_path)
        self._take_params_file()
        self._take_followed_log()
        data = dict(self.settings.data)
        section = data.pop("sensors", {})
        config, config_problems = validate(BenchConfig, data, self.settings)
        tick_hz = (config or BenchConfig()).tick_hz
        sensors, sensor_problems = resolve_sensors(section, self.settings, tick_hz=tick_hz)
        self.problems += config_problems + sensor_problems
        if config is not None:
            parts, part_problems = resolve_parts(config.parts, self.settings)
            config = without_unset_limits(config.model_copy(update={"sensors": sensors, "parts": parts}))
            self.problems += part_problems
            for check in (cross_problems, autopilot_problems, noise_problems, intake_problems, search_problems):
                self.problems += check(config, self.settings)
            if config.companion.on or config.companion.control:
                from hil.config.checks.companion_checks import companion_problems  # loads ZeroMQ

                self.problems += companion_problems(config, self.settings, scripted=script is not None)
        vehicle = self._vehicle()
        if config is not None:
            self.problems += build_problems(config, self.settings, winged=vehicle is not None and vehicle.has_wings)
        if config is not None and vehicle is not None:
            self.problems += vehicle_problems(config, vehicle, self.settings)
            self.problems += airframe_problems(config, vehicle, self.settings)
            firmware = firmware_for(config.autopilot.profile, vehicle)
            self.problems += set_point_problems(config, firmware, self.settings)
        scene = self._scene(vehicle, config)
        if config is not None and scene is not None:
            self.problems += site_problems(config, scene)
            self.problems += almanac_problems(config, scene, self.settings)
        if mission_path is not None and is_script(mission_path):
            mission_path = script.plan_path if script is not None else None
        if config is not None and scene is not None and not self.problems:
            self.problems += radar_checks.world_problems(config, scene, self.settings)
        mission = self._mission(mission_path, scene)
        if config is not None and mission is not None and scene is not None:
            mission = shifted_mission(mission, config.mission_offset_m, scene)
        bench = None
        if config is not None and vehicle is not None and scene is not None and not self.problems:
            if script is not None and not self.complete:
                config = config.model_copy(update={"wind": with_gusts(config.wind, scene.wind_W_mps, script)})
            bench = Bench(config, vehicle, scene, mission, self.files, script)
            self.problems += flight_problems(bench, self.settings)
            if flown and not config.vehicles:  # of several vehicles each is loaded by itself
                self.problems += self._missing(bench)
        if script is not None:
            self.problems += mission_problems(script, mission)
            if config is not None and config.crash is None and script.script.outcome == "crashed":
                message = "expects a crash, but crashes are not judged (crash: null)"
                self.problems.append(at(script.document, ("outcome",), message))
            if config is not None and vehicle is not None:
                self.problems += bench_problems(script, sensors=sample_types(config), vehicle=vehicle)
                self.problems += script_intake_problems(config, script, firmware_for(config.autopilot.profile, vehicle))
        if config is not None and mission is not None and not sensor_problems:
            missing = config.missing_sensors()
            if missing:
                message = f"must hold a {' and a '.join(missing)} that feeds the flight controller: it flies a mission"
                self.problems.append(at(self.settings, ("sensors",), message))
        if self.problems or bench is None:
            raise ConfigError(_in_order(self.problems))
        return bench

    def _missing(self, bench: Bench) -> list[Problem]:
        """Report what a flight needs besides its files."""
        problems = missing_object_problems(bench.config, bench.scene, self.settings)
        if not bench.config.companion.start:
            return problems
        from hil.config.checks.companion_checks import missing_client_problems  # loads ZeroMQ

        return problems + missing_client_problems(bench.config, self.settings)


def _in_order(problems: list[Problem]) -> list[Problem]:
    """Sort problems by file, in order of first appearance, and by line, the command line last, without repetitions."""
    files: dict[str, int] = {}
    keyed: dict[str, tuple[tuple[bool, int, int], Problem]] = {}
    for problem in problems:
        source, _, line = problem.where.rpartition(":")
        if not line.isdigit():
            source, line = problem.where, "0"
        order = files.setdefault(source, len(files))
        keyed.setdefault(str(problem), ((source.startswith(COMMAND_LINE), order, int(line)), problem))
    return [problem for _, problem in sorted(keyed.values(), key=lambda pair: pair[0])]


def _of_command_line(key: str, options: Mapping[str, Any], settings: Sequence[str]) -> tuple[Any, str] | None:
    """Return value and origin of a key: of its last --set, else of its option; None if neither is given."""
    for text in reversed(settings):
        if text.partition("=")[0].strip() == key:
            try:
                _, value, origin = parse_setting(text)
            except ConfigError:
                continue  # reported by merge_options
            return value, origin
    return (options[key], f"--{key}") if key in options else None
