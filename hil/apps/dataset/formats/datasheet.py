"""Datasheet of a data set, `index.html`: contents, provenance and known limits on one page without external files.

Pictures are embedded, so the page can be passed on alone. The page does not depend on when or where it is written.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby

from hil.apps.dataset.formats.split import GUARD, SETS, Split
from hil.run.report.html import table
from signals.classes import Classes

PAGE_NAME = "index.html"
LICENCE = "CC0-1.0"  # for content made by a program; the scene's own textures and meshes keep their licences

# Limits common to all data sets of this bench.
LIMITS = (
    "All data are simulated: appearance, materials and motion are simpler than in the real world.",
    "Boxes and masks hold visible pixels only; the hidden share of an object is estimated from depth along its rim.",
    "Depth pictures have a step and a maximum, stated below; farther surfaces are marked, not measured.",
    "Sets are split by segments of one trajectory: an object that is passed twice can be in two sets.",
)

Rows = Sequence[Sequence[str]]
# Okabe and Ito's palette, distinguishable with any colour vision.
_SET_COLOURS = {"train": "#0072b2", "validation": "#e69f00", "test": "#009e73", GUARD: "#bbbbbb"}


@dataclass(frozen=True, kw_only=True)
class Datasheet:
    """Contents of the datasheet. All texts are plain text, not HTML."""

    title: str
    about: Sequence[str]  # paragraphs
    provenance: Mapping[str, str]  # scene, seed, mission and everything else needed to make the data set again
    sensors: Rows  # name, folder, contents, rate, samples
    formats: Mapping[str, str]  # file or folder to its contents and unit
    split: Split
    classes: Classes
    class_pixels: Sequence[int]  # over all pictures
    class_objects: Mapping[int, Sequence[int]]  # by class: objects in train, validation, test and in no set
    pictures: Sequence[tuple[str, str, bytes]]  # title, kind (png, jpeg), bytes
    limits: Sequence[str] = LIMITS


def datasheet_html(sheet: Datasheet) -> str:
    """Return the page as HTML text."""
    split, class_objects = sheet.split, sheet.class_objects
    counts, shares = split.counts, split.shares
    sets = [(name, str(counts[name]), f"{100.0 * shares[name]:.1f} %") for name in SETS]
    parts = [
        *(f"<p>{escape(text)}</p>" for text in sheet.about),
        f"<p><b>{sum(sum(row) for row in class_objects.values())}</b> labelled objects.</p>",
        "<h2>Samples</h2>",
        f"<div class='pictures'>{''.join(_picture(*p) for p in sheet.pictures)}</div>",
        "<h2>How it was made</h2>",
        table(list(sheet.provenance.items())),
        "<h2>Sensors</h2>",
        table(sheet.sensors, ("sensor", "folder", "holds", "rate [Hz]", "samples")),
        "<h2>Files</h2>",
        table(list(sheet.formats.items())),
        "<h2>Split</h2>",
        "<p>By segments of the trajectory, not by frame; frames between sets are left out as guards.</p>",
        _split_bar(split),
        table([*sets, (GUARD, str(counts[GUARD]), "in no set")], ("set", "frames", "share")),
        "<h2>Classes</h2>",
        table(
            _class_rows(sheet.classes, sheet.class_pixels, class_objects),
            ("id", "class", "pixels", "share", "objects: train", "validation", "test", "in no set"),
        ),
        "<h2>Known limits</h2>",
        "<ul>" + "".join(f"<li>{escape(text)}</li>" for text in sheet.limits) + "</ul>",
        "<h2>Licence</h2>",
        f"<p>{escape(LICENCE)}</p>",
    ]
    title = escape(sheet.title)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>\n'
        f"<style>{_CSS}</style></head><body>\n<h1>{title}</h1>\n" + "\n".join(parts) + "\n</body></html>\n"
    )


def _class_rows(classes: Classes, pixels: Sequence[int], objects: Mapping[int, Sequence[int]]) -> Rows:
    """Return a row for each class seen in the data, by falling number of pixels."""
    total = max(sum(pixels), 1)
    seen = [i for i, count in enumerate(pixels) if count or any(objects.get(i, ()))]
    return [
        (
            *(str(i), classes.name(i), str(pixels[i]), f"{100.0 * pixels[i] / total:.3g} %"),
            *map(str, objects.get(i, ["-"] * 4)),
        )
        for i in sorted(seen, key=lambda i: (-pixels[i], i))
    ]


def _split_bar(split: Split) -> str:
    """Return a bar that shows the sets along the trajectory."""
    bars = "".join(
        f"<span style='flex:{len(list(frames))};background:{_SET_COLOURS[name]}' title='{name}'></span>"
        for name, frames in groupby(split.set_by_frame)
    )
    legend = " ".join(f"<span style='color:{colour}'>\N{BLACK SQUARE}</span> {n}" for n, colour in _SET_COLOURS.items())
    return f"<div class='strip'>{bars}</div><p>{legend}</p>"


def _picture(title: str, kind: str, data: bytes) -> str:
    title, source = escape(title), base64.b64encode(data).decode()
    return (
        f'<figure><img alt="{title}" src="data:image/{kind};base64,{source}"><figcaption>{title}</figcaption></figure>'
    )


_CSS = """
body{font:15px/1.45 system-ui,sans-serif;max-width:1060px;margin:2em auto;padding:0 1em;color:#20262e}
h1{margin-bottom:.2em}h2{margin-top:1.6em;border-bottom:1px solid #d8dce2}
table{border-collapse:collapse;font-size:14px}
td,th{padding:.2em .8em .2em 0;text-align:left;border-bottom:1px solid #eee}
.pictures{display:flex;flex-wrap:wrap;gap:10px}figure{margin:0}
figure img{width:320px;image-rendering:pixelated}
figcaption{font-size:13px;color:#5b636e}.strip{display:flex;max-width:640px;height:18px}
"""
