"""Seasons, for the plants of a map."""

from typing import Literal

Season = Literal["spring", "summer", "autumn", "winter"]
