"""Camera pose in a scene, for pictures of `hil view`."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from signals.documents.validate import StrictModel

_Coordinate = Annotated[float, Field(ge=-50_000.0, le=50_000.0)]


class ViewPoint(StrictModel):
    """Position and view direction: yaw from east towards north, pitch downwards (as a sensor's mount)."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    at_m: tuple[_Coordinate, _Coordinate, _Coordinate]  # in W
    look_deg: tuple[Annotated[float, Field(ge=-360.0, le=360.0)], Annotated[float, Field(ge=-90.0, le=90.0)]]
