"""Methods that draw in the scene (simPlot*): the dashboard shows the drawings, pictures do not."""

from __future__ import annotations

from collections.abc import Sequence

from hil.apps.airsim.rpc.arguments import BOOL, COLOUR, FLOAT, FLOAT_OR_NAN, POSE, TEXT, VECTOR, Pose, Vector, list_of
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method, optional
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.drawings import Pen

_MOST_POINTS = 100_000
_RED = [1.0, 0.0, 0.0, 1.0]


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    drawings = simulation.drawings

    def plot_points(points: list[Vector], *pen: object) -> None:
        drawings.points(points, Pen(*pen))  # type: ignore[arg-type]

    def plot_strip(points: list[Vector], *pen: object) -> None:
        drawings.lines(points, Pen(*pen), strip=True)  # type: ignore[arg-type]

    def plot_list(points: list[Vector], *pen: object) -> None:
        drawings.lines(points, Pen(*pen), strip=False)  # type: ignore[arg-type]

    def plot_arrows(
        begin: list[Vector], end: list[Vector], colour: list[float], width: float, size: float, time: float, stays: bool
    ) -> None:
        _check_counts("starts of arrows", begin, "ends", end)
        drawings.arrows(begin, end, size, Pen(colour, width, time, stays))

    def plot_strings(texts: list[str], points: list[Vector], _: float, colour: list[float], time: float) -> None:
        _check_counts("strings", texts, "positions", points)
        drawings.strings(texts, points, Pen(colour, 0.0, time))

    def plot_transforms(poses: list[Pose], scale: float, width: float, time: float, stays: bool) -> None:
        drawings.transforms(poses, scale, Pen(_RED, width, time, stays))

    def plot_named(
        poses: list[Pose], names: list[str], scale: float, width: float, _: float, colour: list[float], time: float
    ) -> None:
        _check_counts("poses", poses, "names", names)
        drawings.transforms(poses, scale, Pen(colour, width, time), names)

    def points(name: str) -> Parameter:
        return Parameter(name, list_of(VECTOR, most=_MOST_POINTS))

    poses, texts = Parameter("poses", list_of(POSE, most=_MOST_POINTS)), list_of(TEXT, most=_MOST_POINTS)
    colour = optional("color_rgba", COLOUR, _RED)
    size, thickness = optional("size", FLOAT, 10.0), optional("thickness", FLOAT, 5.0)
    scale = optional("scale", FLOAT, 5.0)
    end = (optional("duration", FLOAT_OR_NAN, -1.0), optional("is_persistent", BOOL, False))
    return [
        method("simFlushPersistentMarkers", drawings.clear),
        method("simPlotPoints", plot_points, points("points"), colour, size, *end),
        method("simPlotLineStrip", plot_strip, points("points"), colour, thickness, *end),
        method("simPlotLineList", plot_list, points("points"), colour, thickness, *end),
        method(
            "simPlotArrows",
            plot_arrows,
            points("points_start"),
            points("points_end"),
            colour,
            thickness,
            optional("arrow_size", FLOAT, 2.0),
            *end,
        ),
        method("simPlotStrings", plot_strings, Parameter("strings", texts), points("positions"), scale, colour, end[0]),
        method("simPlotTransforms", plot_transforms, poses, scale, thickness, *end),
        method(
            "simPlotTransformsWithNames",
            plot_named,
            poses,
            Parameter("names", texts),
            optional("tf_scale", FLOAT, 5.0),
            optional("tf_thickness", FLOAT, 5.0),
            optional("text_scale", FLOAT, 10.0),
            optional("text_color_rgba", COLOUR, _RED),
            end[0],
        ),
    ]


def _check_counts(what: str, first: Sequence[object], other: str, second: Sequence[object]) -> None:
    if len(first) != len(second):
        raise RpcError(f"{len(first)} {what} and {len(second)} {other}; there must be as many of both")
