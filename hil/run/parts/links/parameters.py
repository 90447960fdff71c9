"""The parameters of the section `autopilot`: compared with what the autopilot reports, before it may arm."""

from __future__ import annotations

from firmware_bridge.ground_station.parameter_check import ParameterCheck
from hil.config import Bench
from hil.run.part import Part, RunContext


class ParametersPart(Part):
    name = "parameters"

    def __init__(self, check: ParameterCheck) -> None:
        self._check = check

    def command_sources(self) -> list[ParameterCheck]:
        return [self._check]

    def may_arm(self) -> bool:
        return self._check.done

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
    return ParametersPart(ParameterCheck(wanted, firmware))
