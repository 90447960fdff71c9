"""The fixed keys of run.json, schema 1. A run may add others; what could not be measured is null."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

_STRICT = ConfigDict(strict=True, allow_inf_nan=False, extra="allow")
_Number = float | None


def _section(**kinds: Any) -> type[BaseModel]:
    fields: Any = {name: (kind, ...) for name, kind in kinds.items()}
    return create_model("Section", __config__=_STRICT, **fields)


_RUN = _section(
    status=Literal["PASS", "FAIL", "ERROR"],
    error=_section(type=str, message=str) | None,
    digest=Annotated[str, Field(pattern="^[0-9a-f]+$")],
    deterministic=bool,
    seed=int,
    rig=str,
    scene=str,
    sim_s=_Number,
    wall_s=_Number,
    realtime_factor=_Number,
    mission=_section(completed=bool, waypoints=int, reached=int, max_cross_track_m=_Number, final_error_m=_Number),
    autopilot=_section(kind=str, steps=int, late=int, rtt_us=_section(p50=_Number, p99=_Number, max=_Number)),
    sensors=dict[str, _section(samples=int, skipped=int, ms=_section(p50=_Number, p99=_Number))],  # type: ignore[misc]
    skipped=list[Any],
)

# A run.json that meets the schema.
RUN = {
    "schema": 1,
    "status": "PASS",
    "error": None,
    "digest": "0f" * 32,
    "deterministic": True,
    "seed": 1,
    "rig": "mock",
    "scene": "city_park",
    "sim_s": 96.5,
    "wall_s": 3.5,
    "realtime_factor": 27.6,
    "mission": {
        "completed": True,
        "waypoints": 4,
        "reached": 4,
        "max_cross_track_m": 0.31,
        "final_error_m": 0.12,
        "landing_speed_mps": 0.66,
    },
    "autopilot": {"kind": "mock", "steps": 24_000, "late": 0, "rtt_us": {"p50": 90.0, "p99": 180.0, "max": 900.0}},
    "sensors": {"imu": {"samples": 24_000, "skipped": 0, "ms": {"p50": 0.01, "p99": 0.02}}},
    "skipped": [{"what": "front", "why": "nobody reads <front/rgb>", "saved": "965 samples"}],
    "verdict": {
        "reasons": [],
        "rows": [
            {"name": "max_cross_track_m", "value": 0.31, "limit": 1.0, "unit": "m", "ok": True},
            {"name": "landing_speed_mps", "value": 0.66, "limit": None, "unit": "m/s", "ok": True},
        ],
    },
}


def problems_of(run: Any) -> list[str]:
    """Return every difference of `run` from the schema."""
    try:
        _RUN.model_validate(run)
    except ValidationError as error:
        return [f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors()]
    problems = [] if run.get("schema") == 1 else [f"schema: must be 1, not {run.get('schema')!r}"]
    if (run["status"] == "ERROR") != (run["error"] is not None):
        problems.append("error: must be there with status ERROR and null without")
    return problems
