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
