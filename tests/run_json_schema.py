"""The fixed keys of run.json, schema 1. A run may add others; what could not be measured is null."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator


class _Section(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False, extra="allow")


class _Error(_Section):
    type: str
    message: str


class _Mission(_Section):
    completed: bool
    waypoints: int
    reached: int
    max_cross_track_m: float | None
    final_error_m: float | None


class _RoundTrips(_Section):
    p50: float | None
    p99: float | None
    max: float | None


class _Autopilot(_Section):
    kind: str
    steps: int
    late: int
    rtt_us: _RoundTrips


class _Times(_Section):
    p50: float | None
    p99: float | None


class _Sensor(_Section):
    samples: int
    skipped: int
    ms: _Times


class _Run(_Section):
    schema_: Literal[1] = Field(alias="schema")
    status: Literal["PASS", "FAIL", "ERROR"]
    error: _Error | None
    digest: str = Field(pattern="^[0-9a-f]+$")
    deterministic: bool
    seed: int
    rig: str
    scene: str
    sim_s: float | None
    wall_s: float | None
    realtime_factor: float | None
    mission: _Mission
    autopilot: _Autopilot
    sensors: dict[str, _Sensor]
    skipped: list[Any]

    @model_validator(mode="after")
    def _error_with_status(self) -> _Run:
        assert (self.status == "ERROR") == (self.error is not None)
        return self


def problems_of(run: Any) -> list[str]:
    """Everything in which `run` departs from the schema."""
    try:
        _Run.model_validate(run)
    except ValidationError as error:
        return [f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors()]
    return []
