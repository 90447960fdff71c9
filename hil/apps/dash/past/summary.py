"""run.json of a past run and campaign.json of a campaign, read as files that anybody may have written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NoReturn

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from hil.run_files import RUN_JSON_NAME, SUMMARY_NAME
from signals.errors import RecordingError

_MAX_BYTES = 64 << 20


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True)


class _Mission(_Strict):
    file: str | None = None


class _Error(_Strict):
    type: str
    message: str = ""


class _Verdict(_Strict):
    reasons: list[str] = []
    rows: list[dict[str, Any]] = []


class _Summary(_Strict):
    """The keys that the page shows."""

    status: str
    digest: str = ""
    deterministic: bool | None = None
    seed: int | None = None
    rig: str | None = None
    scene: str | None = None
    sim_s: float | None = None
    wall_s: float | None = None
    realtime_factor: float | None = None
    mission: _Mission | None = None
    error: _Error | None = None
    verdict: _Verdict | None = None
    by_hand: list[dict[str, Any]] | None = None
    skipped: list[dict[str, Any]] | None = None


class _Doing(_Strict):
    phase: str
    done: int
    total: int


class _Campaign(_Strict):
    """The keys of campaign.json that the page shows."""

    cases: int
    passed: int = Field(alias="pass")
    fail: int
    error: int
    flake: int
    pass_rate: list[float | None] = Field(min_length=3, max_length=3)
    points: int | None = None
    complete: bool = True
    stopped: str | None = None
    doing: _Doing | None = None


def read_summary(folder: Path) -> dict[str, Any] | None:
    """Return run.json of a run; None if the folder has none. Raises RecordingError if it is damaged."""
    return _read(folder / RUN_JSON_NAME, _Summary)


def read_campaign(folder: Path) -> dict[str, Any] | None:
    """Return campaign.json of a campaign; None if there is none. Raises RecordingError if it is damaged."""
    return _read(folder / SUMMARY_NAME, _Campaign)


def _read(path: Path, model: type[BaseModel]) -> dict[str, Any] | None:
    try:
        if not path.is_file():
            return None
        if path.stat().st_size > _MAX_BYTES:
            raise ValueError(f"more than {_MAX_BYTES >> 20} MB")
        data = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
        model.model_validate(data)
        json.dumps(data, ensure_ascii=False).encode()  # fails for half of a surrogate pair
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"])) or "the document"
        raise RecordingError(f"{path}: damaged: {key}: {first['msg']}") from error
    except (OSError, ValueError, RecursionError) as error:
        raise RecordingError(f"{path}: damaged: {error}") from error
    return dict(data)


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is not a number of JSON")
