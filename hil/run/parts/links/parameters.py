"""The parameters of the section `autopilot` and of the script: compared with the autopilot's, before it may arm."""

from __future__ import annotations

from firmware_bridge.ground_station.parameter_check import ParameterCheck
from hil.config import Bench
from hil.run.part import Part, RunContext
from signals.documents.yaml_lines import dotted


class ParametersPart(Part):
    name = "parameters"
    _run: RunContext  # from `begin` on

    def __init__(self, check: ParameterCheck) -> None:
        self._check = check

    def command_sources(self) -> list[ParameterCheck]:
        return [self._check]

    def may_arm(self) -> bool:
        return self._check.done

    def begin(self, run: RunContext) -> None:
        self._run = run

    def before_tick(self) -> None:
        if self._check.finding:
            self._run.say("parameters", f"autopilot.params_file: {self._check.finding}")
            self._check.finding = ""

    def conclude(self, run: RunContext) -> None:
        if not (self._check.done or run.stopped_by_hand):
            raise self._check.unfinished()


def make(bench: Bench) -> Part:
    autopilot = bench.config.autopilot
    firmware = autopilot.profile.firmware
    wanted = dict(autopilot.params)
    number = autopilot.airframe
    if firmware.airframe_parameter and number is not None and number.isdigit():
        wanted.setdefault(firmware.airframe_parameter, float(number))
    script = bench.script
    named = {}
    if script is not None and not autopilot.profile.known_params:
        named = {str(place[-1]): f"{script.document.where(place)}: {dotted(place)}" for place in script.required_params}
    of_file = {name: value for name, value in autopilot.params_of_file.items() if name not in wanted}
    return ParametersPart(ParameterCheck(wanted, firmware, named, of_file))
