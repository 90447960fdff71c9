"""Pictures of environments: `render_mode` rgb_array and human."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from hil.config import Bench
from hil.gym.flight import Flight
from hil.gym.options import FlightOptions
from hil.run.film.film import ALONE, Film, Picture, check_view
from signals.errors import ConfigError, Problem
from signals.samples import Vec3

RENDER_MODES = ["human", "rgb_array"]


def check_mode(mode: str | None, name: str) -> str | None:
    """Return a render mode. Raises ConfigError for an unknown one."""
    if mode is not None and mode not in RENDER_MODES:
        raise ConfigError.at(name, f"render_mode {mode!r} is unknown", "choose rgb_array or human")
    return mode


def rendering(metadata: Mapping[str, Any], step_s: float) -> dict[str, Any]:
    """Return the metadata of an environment with the rate of its pictures: one a step."""
    return {**metadata, "render_fps": max(1, round(1.0 / step_s))}


class Pictures:
    """The films of a batch; each is made with its first picture. Raises ConfigError for a view that there is not."""

    def __init__(self, bench: Bench, options: FlightOptions, name: str) -> None:
        self._options = options
        self._films: dict[int, tuple[Bench, Film]] = {}
        try:
            check_view(bench, options.render_view)
        except ConfigError as error:
            raise ConfigError([Problem(name, f"render_{each}") for each in error.problems]) from None

    def restart(self, row: int) -> None:
        """Another episode begins."""
        if row in self._films:
            self._films[row][1].restart()

    def draw(self, row: int, flight: Flight, marks: Sequence[Vec3]) -> Picture:
        """Return the picture of a flight."""
        bench, film = self._films.get(row, (None, None))
        if film is None or bench is not flight.bench:
            if film is not None:
                film.close()
            film = Film(flight.bench, self._options.render_size, self._options.render_view)
            self._films[row] = flight.bench, film
        return film.picture({ALONE: flight.truth}, marks)

    def close(self) -> None:
        """Release renderers."""
        for _, film in self._films.values():
            film.close()
        self._films.clear()


class Window:
    """Window on the screen for `render_mode="human"`, made by pygame."""

    def __init__(self, title: str, rate_hz: float) -> None:
        """Raises gymnasium.error.DependencyNotInstalled without pygame."""
        try:
            self._pygame: Any = import_module("pygame")
        except ImportError as error:
            from gymnasium.error import DependencyNotInstalled

            raise DependencyNotInstalled("render_mode human needs pygame: pip install pygame") from error
        self._title, self._rate_hz = title, rate_hz
        self._screen: Any = None

    def show(self, picture: Picture) -> None:
        """Show a picture, and wait for its time."""
        pygame = self._pygame
        if self._screen is None:
            pygame.display.init()
            pygame.display.set_caption(self._title)
            self._screen = pygame.display.set_mode((picture.shape[1], picture.shape[0]))
            self._clock = pygame.time.Clock()
        self._screen.blit(pygame.surfarray.make_surface(np.swapaxes(picture, 0, 1)), (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(self._rate_hz)

    def close(self) -> None:
        """Close the window."""
        if self._screen is not None:
            self._pygame.display.quit()
            self._screen = None

    def __deepcopy__(self, memo: dict[int, Any]) -> Window:
        return Window(self._title, self._rate_hz)

    def __reduce__(self) -> tuple[Any, ...]:
        return Window, (self._title, self._rate_hz)
