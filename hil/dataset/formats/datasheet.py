"""`index.html` of a data set: what it is, how it was made, what is in it, what it cannot do. One file, no network.

Pictures are within the page, so that it can be sent on alone. Nothing in it depends on when or where it was written.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape

from hil.dataset.formats.split import GUARD, SETS, Split
from hil.signals.classes import Classes

PAGE_NAME = "index.html"
LICENCE = "CC0-1.0"  # of content that a program made; the scene's own textures and meshes keep theirs

# What holds for every data set of this bench.
LIMITS = (
    "All data are simulated: appearance, materials and motion are simpler than the world's.",
    "Boxes and masks hold visible pixels only; how much of a thing is hidden is estimated from depth along its rim.",
    "Depth pictures have a step and a farthest depth, stated below; what is farther is marked, not measured.",
    "Sets are split by segments of one trajectory: a place that is flown past twice can be in two sets.",
)


@dataclass(frozen=True)
class SensorRow:
    """A sensor as the page's table shows it."""

    name: str
    folder: str
    holds: str
    rate_hz: float
    samples: int


@dataclass(frozen=True)
class SamplePicture:
    """A channel to look at: `data` is a PNG or JPEG."""

    title: str
    data: bytes
    key: str = ""  # part of a file's name


@dataclass(frozen=True)
class Datasheet:
    """Everything the page says. Texts are plain, not HTML."""

    title: str
    about: Sequence[str]  # paragraphs
    made: Mapping[str, str]  # scene, seed, mission, quality, ...: how to make the same again
    frames: int
    duration_s: float
    sensors: Sequence[SensorRow]
    classes: Classes
    class_pixels: Sequence[int]  # of all pictures
    class_objects: Mapping[int, Sequence[int]]  # by class: objects in train, validation, test, and outside
    split: Split
    formats: Mapping[str, str] = field(default_factory=dict)  # file or folder: what it holds, in which unit
    pictures: Sequence[SamplePicture] = ()
    licence: str = LICENCE
    limits: Sequence[str] = LIMITS


def datasheet_html(sheet: Datasheet) -> str:
    """The page."""
    counts = sheet.split.counts
    shares = sheet.split.shares
    split_rows = [(name, str(counts[name]), f"{100.0 * shares[name]:.1f} %") for name in SETS]
    split_rows.append((GUARD, str(counts[GUARD]), "in no set"))
    sensors = [(s.name, s.folder, s.holds, f"{s.rate_hz:g}", str(s.samples)) for s in sheet.sensors]
    parts = [
        *(f"<p>{escape(text)}</p>" for text in sheet.about),
        f"<p><b>{sheet.frames}</b> frames over <b>{sheet.duration_s:.2f} s</b>, "
        f"{sum(sum(row) for row in sheet.class_objects.values())} labelled objects.</p>",
        "<h2>Samples</h2>",
        f"<div class='pictures'>{''.join(_picture(p) for p in sheet.pictures)}</div>",
        "<h2>How it was made</h2>",
        _table((), list(sheet.made.items())),
        "<h2>Sensors</h2>",
        _table(("sensor", "folder", "holds", "rate [Hz]", "samples"), sensors),
        "<h2>Files</h2>",
        _table((), list(sheet.formats.items())),
        "<h2>Split</h2>",
        "<p>By segments of the trajectory, not by frame; frames between sets are left out as guards.</p>",
        _strip(sheet.split),
        _table(("set", "frames", "share"), split_rows),
        "<h2>Classes</h2>",
        histogram_svg(sheet.classes, sheet.class_pixels),
        _table(("id", "class", "pixels", "objects: train", "validation", "test", "in no set"), _class_rows(sheet)),
        "<h2>Known limits</h2>",
        "<ul>" + "".join(f"<li>{escape(text)}</li>" for text in sheet.limits) + "</ul>",
        "<h2>Licence</h2>",
        f"<p>{escape(sheet.licence)}</p>",
    ]
    title = escape(sheet.title)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>\n'
        f"<style>{_CSS}</style></head><body>\n<h1>{title}</h1>\n" + "\n".join(parts) + "\n</body></html>\n"
    )


def histogram_svg(classes: Classes, class_pixels: Sequence[int]) -> str:
    """Share of all pixels by class, the most frequent first; the scale is of powers of ten."""
    seen = sorted(((n, i) for i, n in enumerate(class_pixels) if n), key=lambda pair: (-pair[0], pair[1]))
    total = sum(n for n, _ in seen)
    if not total:
        return "<p>No pixels were counted.</p>"
    bars = []
    for row, (count, class_id) in enumerate(seen):
        y = row * _BAR_PX
        colour = classes.colours[class_id] if class_id < len(classes.colours) else (128, 128, 128)
        bars.append(
            f'<text x="132" y="{y + 12}" text-anchor="end">{escape(classes.name(class_id))}</text>'
            f'<rect x="140" y="{y + 2}" width="{_bar_width(count, total)}" height="{_BAR_PX - 4}" '
            f'fill="rgb{colour}" stroke="#555" stroke-width="0.5"/>'
            f'<text x="{146 + _bar_width(count, total)}" y="{y + 12}">{100.0 * count / total:.3g} %</text>'
        )
    height = len(seen) * _BAR_PX
    return f'<svg width="640" height="{height}" role="img" aria-label="pixels by class">{"".join(bars)}</svg>'


_BAR_PX = 17
_DECADE_PX = 70
_DECADES = 6


def _bar_width(count: int, total: int) -> int:
    """One decade of the share takes `_DECADE_PX`, linear within it; six decades are shown."""
    share = count / total
    width = _DECADES * _DECADE_PX
    for _ in range(_DECADES):
        if share > 0.1:
            return round(width - _DECADE_PX * (1.0 - share) / 0.9)
        share *= 10.0
        width -= _DECADE_PX
    return 1


def _class_rows(sheet: Datasheet) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for class_id, pixels in enumerate(sheet.class_pixels):
        objects = sheet.class_objects.get(class_id, ())
        if pixels or any(objects):
            counts = [str(n) for n in objects] if objects else ["-"] * 4
            rows.append((str(class_id), sheet.classes.name(class_id), str(int(pixels)), *counts))
    return rows


def _strip(split: Split) -> str:
    """The sets along the trajectory, as a bar."""
    frames = len(split.of_frame)
    bars = []
    first = 0
    for i in range(1, frames + 1):
        if i == frames or split.of_frame[i] != split.of_frame[first]:
            name = split.of_frame[first]
            bars.append(
                f'<rect x="{640.0 * first / frames:.2f}" width="{640.0 * (i - first) / frames:.2f}" height="18" '
                f'fill="{_SET_COLOURS[name]}"><title>{name}: frames {first} to {i - 1}</title></rect>'
            )
            first = i
    legend = " ".join(f"<span style='color:{colour}'>\N{BLACK SQUARE}</span> {n}" for n, colour in _SET_COLOURS.items())
    head = '<svg width="640" height="18" role="img" aria-label="sets along the trajectory">'
    return f"{head}{''.join(bars)}</svg><p>{legend}</p>"


# Okabe and Ito's palette: told apart with any colour vision
_SET_COLOURS = {"train": "#0072b2", "validation": "#e69f00", "test": "#009e73", GUARD: "#bbbbbb"}


def _picture(picture: SamplePicture) -> str:
    kind = "png" if picture.data[:4] == b"\x89PNG" else "jpeg"
    data = base64.b64encode(picture.data).decode()
    title = escape(picture.title)
    return f'<figure><img alt="{title}" src="data:image/{kind};base64,{data}"><figcaption>{title}</figcaption></figure>'


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    first = "".join(f"<th>{escape(text)}</th>" for text in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows)
    return f"<table>{f'<tr>{first}</tr>' if first else ''}{body}</table>"


_CSS = """
body{font:15px/1.45 system-ui,sans-serif;max-width:1060px;margin:2em auto;padding:0 1em;color:#20262e}
h1{margin-bottom:.2em}h2{margin-top:1.6em;border-bottom:1px solid #d8dce2}
table{border-collapse:collapse;font-size:14px}
td,th{padding:.2em .8em .2em 0;text-align:left;border-bottom:1px solid #eee}
.pictures{display:flex;flex-wrap:wrap;gap:10px}figure{margin:0}figure img{max-width:320px}
figcaption{font-size:13px;color:#5b636e}svg text{font:12px system-ui,sans-serif}
"""
