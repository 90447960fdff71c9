"""junit.xml: one testcase for each case, as CI servers read it.

A test's name is the values of its axes, because a server recognises a test by its name from run to run. FAIL and FLAKE
are failures, ERROR is an error.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.sax.saxutils import XMLGenerator
from xml.sax.xmlreader import AttributesImpl

from hil.apps.campaign.results.again import run_command
from hil.apps.campaign.results.groups import value_text
from hil.apps.campaign.results.summary import Summary
from hil.apps.campaign.results.tables import Sink, written
from hil.apps.campaign.store import Case

JUNIT_NAME = "junit.xml"
_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@contextmanager
def junit_cases(path: Path, name: str, summary: Summary, bench: Path | None) -> Iterator[Sink]:
    """Return what writes a case into junit.xml. Raises RecordingError.

    `summary`: statistics of the same cases; `bench`: the base bench.
    """
    tally = summary.tally
    counts = {"tests": tally.cases, "failures": tally.failed + tally.flakes, "errors": tally.errors, "skipped": 0}
    total = {"name": name, **counts, "time": f"{summary.wall_s:.3f}"}
    with written(path) as file:
        xml = XMLGenerator(file, "utf-8", short_empty_elements=True)
        xml.startDocument()
        _start(xml, "testsuites", total)
        _start(xml, "testsuite", total)
        yield lambda case: _testcase(xml, name, case, bench)
        xml.endElement("testsuite")
        xml.endElement("testsuites")
        xml.endDocument()


def _testcase(xml: XMLGenerator, name: str, case: Case, bench: Path | None) -> None:
    outcome, worst = case.outcome, case.outcome.worst
    values = {axis: value_text(value) for axis, value in case.axes.items()}
    test = ", ".join(f"{axis}={value}" for axis, value in values.items()) or name
    _start(xml, "testcase", {"classname": name, "name": test, "time": f"{outcome.wall_s:.3f}"})
    properties: dict[str, Any] = {"case": case.id, **values, "digest": outcome.digest if outcome.repeatable else ""}
    if worst is not None:
        properties |= {"margin": worst.margin, "worst_limit": worst.name}
    if outcome.unmet:
        properties["unmet"] = "; ".join(outcome.unmet)
    _start(xml, "properties", {})
    for key, value in properties.items():
        _element(xml, "property", {"name": key, "value": value})
    xml.endElement("properties")
    if case.status != "PASS":
        tag = "error" if case.status == "ERROR" else "failure"
        kind = {"FAIL": "limit", "FLAKE": "flake", "ERROR": outcome.error_type}[case.status]
        text = "\n".join(filter(None, (case.reason, outcome.error, run_command(bench, case.texts))))
        _element(xml, tag, {"type": kind, "message": outcome.error or case.reason}, text)
    xml.endElement("testcase")
    xml.ignorableWhitespace("\n")


def _element(xml: XMLGenerator, tag: str, attributes: dict[str, Any], text: str = "") -> None:
    _start(xml, tag, attributes)
    xml.characters(_NO_XML.sub("\ufffd", text))
    xml.endElement(tag)


def _start(xml: XMLGenerator, tag: str, attributes: dict[str, Any]) -> None:
    texts = {key: _NO_XML.sub("\ufffd", str(value)) for key, value in attributes.items()}
    xml.startElement(tag, AttributesImpl(texts))
