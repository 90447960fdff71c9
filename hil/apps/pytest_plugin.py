"""pytest plugin: tests fly missions, and every flight is checked for a clean link.

    @pytest.mark.rig("mock")                 # or --hil-rig on the command line, which takes precedence
    @pytest.mark.hil_feature("gps")          # skips the test, with the reason, if the rig has none
    def test_hover(rig, mission):
        run = rig.fly(mission("hover.plan"), seed=3)
        assert run.passed, run.reasons
        assert run.max_cross_track_m < 1.0

A test fails, even if its own assertions hold, if one of its flights is a FAIL whose verdict the test did not read, or
was not clean: a CRC error, bytes that belong to no frame, a dropped frame, a late sample, or an estimator reset in the
air. A flight that ends as ERROR raises `BenchError` at once. `@pytest.mark.hil_allow("late")` declares what a test
expects; the names are those of `HEALTH`.

The files of a flight (run.json, recordings, and a bench.yaml that repeats it) are kept under `--hil-artifacts` if the
test failed, and removed if it passed. JUnit files contain each flight's digest, rig, seed and verdict.

Other tests are unaffected: the bench is imported when a test first uses a fixture of this plugin.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from hil.flown_run import HEALTH, BenchError, Run, health, unread_reasons, verdict_health

if TYPE_CHECKING:
    from firmware_bridge.devices.mock_bus import MockDesk, MockHid, MockSerialPorts, MockUsbBus

_MARKERS = (
    "rig(name): the rig to fly on; --hil-rig takes precedence",
    "hil_feature(name, ...): skip the test if the rig has no such hardware feature or sensor",
    f"hil_allow(name, ...): findings that do not fail the test: {', '.join(HEALTH)}",
)
_NAME_LIMIT = 100
_ACCEPT = (
    'to judge a verdict: assert run.passed, run.reasons, or for an expected FAIL: assert run.status == "FAIL"\n'
    'to accept a finding: @pytest.mark.hil_allow("fail", "late", ...)'
)


@dataclass(repr=False)
class Rig:
    """The rig of one test. Each flight has its own folder and is checked when the test ends."""

    name: str
    features: frozenset[str]
    bench_file: Path | None
    folder: Path
    chosen_name: str | None = None  # by marker or option; None: the bench file's rig
    seed: int | None = None
    settings: tuple[str, ...] = ()
    allowed: frozenset[str] = frozenset()
    report: bool = False
    runs: list[Run] = field(default_factory=list)
    reported: int = 0  # runs in the JUnit file

    def __repr__(self) -> str:
        return f"<Rig {self.name}, {len(self.runs)} runs>"

    def fly(
        self,
        mission: Path | str | None = None,
        *,
        seed: int | None = None,
        scene: str | None = None,
        settings: Sequence[str] = (),
    ) -> Run:
        """Fly `mission` (default: the bench file's) and return the run, be it a PASS or a FAIL.

        `settings` are texts of `--set`. Raises BenchError if the run is an ERROR (unless the test allows it), and fails
        the test with all problems if a file is wrong.
        """
        from hil.config import load_bench
        from hil.run.bench_run import run_bench
        from signals.errors import ConfigError

        # The report costs more than a short flight; `hil run OUT/bench.yaml` makes it for a run that was kept. The tlog
        # shows the resets of the estimator.
        record = ("record.tlog=true", *(() if self.report else ("record.report=false",)))
        try:
            bench = load_bench(
                self.bench_file,
                rig=self.chosen_name,
                scene=scene,
                mission=None if mission is None else str(mission),
                seed=self.seed if self.seed is not None else seed,
                settings=(*record, *settings, *self.settings),
            )
        except ConfigError as error:
            message = f"the bench cannot be flown:\n{error}"
            raise pytest.fail.Exception(message, pytrace=False) from None
        result = run_bench(bench, self.folder / f"run-{len(self.runs) + 1}", quiet=True)
        run = Run(result.run, result.out)
        self.runs.append(run)
        if (run.json["error"] or {}).get("type") == "Interrupted":
            raise KeyboardInterrupt  # the bench has closed its recordings, so pytest may stop now
        if result.status == "ERROR" and "error" not in self.allowed:
            raise BenchError(run)
        return run

    def findings(self, since: int = 0) -> list[str]:
        """Return one line per flight, from number `since` on (0: the first), and item of `HEALTH` not allowed."""
        lines = []
        for number, run in enumerate(self.runs[since:], start=since + 1):
            prefix = f"run {number}: " if len(self.runs) > 1 else ""
            # A lost vehicle may fail in a group that passes, so the verdict is the group's.
            verdict = verdict_health(run)
            link = dict.fromkeys(verdict, 0)
            found = {f"{name}: ": health(vehicle) | link for name, vehicle in run.vehicles.items()}
            found[""] = verdict if found else health(run)
            for name, counts in found.items():
                for finding, count in counts.items():
                    if not count or finding in self.allowed:
                        continue
                    lines.append(f"{prefix}{name}{finding}: {count} ({HEALTH[finding]})")
                    if finding in verdict:
                        lines += [f"  {reason}" for reason in unread_reasons(run)] + [f"  the run is in {run.out}"]
        return lines


# -- options and markers ----------------------------------------------------------------------------------------


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the plugin's command-line options."""
    group = parser.getgroup("hil", "hardware-in-the-loop bench")
    group.addoption("--hil-rig", metavar="RIG", help="fly every test on this rig, regardless of its marker")
    group.addoption("--hil-config", metavar="FILE", help="bench file; default: the hil.yaml nearest to the test")
    group.addoption("--hil-seed", metavar="N", type=int, help="fly every test with this seed")
    group.addoption("--hil-set", metavar="KEY=VALUE", action="append", default=[], help="override any key of the bench")
    group.addoption(
        "--hil-artifacts", metavar="DIR", default="hil-artifacts", help="folder for the runs of failed tests"
    )
    group.addoption("--hil-keep", action="store_true", help="keep every run, with its report")


def pytest_configure(config: pytest.Config) -> None:
    """Register the plugin's markers."""
    for line in _MARKERS:
        config.addinivalue_line("markers", line)


_RIG = pytest.StashKey[Rig]()
_FAILED = pytest.StashKey[bool]()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test whose rig lacks a feature, before any fixture costs time."""
    required = [name for marker in item.iter_markers("hil_feature") for name in marker.args]
    if not required:
        return
    name, features = _rig_of(item)
    missing = [feature for feature in dict.fromkeys(required) if feature not in features]
    if missing:
        from signals.documents.validate import nearest

        present = ", ".join(sorted(features)) or "nothing"
        hints = [f" ({hint})" for feature in missing if (hint := nearest(feature, sorted(features), listed=False))]
        pytest.skip(f"rig {name!r} has no {' and no '.join(missing)}{''.join(hints)}; it has: {present}")


@pytest.hookimpl(wrapper=True, specname="pytest_runtest_setup")
def pytest_runtest_skipped_setup(item: pytest.Item) -> Generator[None, Any, Any]:
    """Check the flights of a fixture that then skips the test."""
    return (yield from _checked_if_left(item, since=0))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Check the flights of a passed test: here and not at teardown, where a fault would count as an error.

    Also those of a test that then skips itself or calls `pytest.xfail`, which nobody looks at.
    """
    outcome = yield from _checked_if_left(item, since=0)
    _check_flights(item, since=0)
    return outcome


def _checked_if_left(item: pytest.Item, *, since: int) -> Generator[None, Any, Any]:
    """Run what a hook wraps; if it skips the test or calls `pytest.xfail`, check the flights from number `since` on.

    A test that the marker `xfail` expects to fail may do so for its flights.
    """
    from unittest import SkipTest

    try:
        return (yield)
    except (pytest.skip.Exception, pytest.xfail.Exception, SkipTest):
        _check_flights(item, since=since)
        raise


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, Any, Any]:
    """Check the flights that fixtures make after the test, which it cannot have judged."""
    rig = item.stash.get(_RIG, None)
    before = 0 if rig is None else len(rig.runs)
    outcome = yield from _checked_if_left(item, since=before)
    _check_flights(item, since=before)
    return outcome


def _check_flights(item: pytest.Item, *, since: int) -> None:
    """Fail the test if one of its flights from number `since` on was not clean."""
    rig = item.stash.get(_RIG, None)
    findings = [] if rig is None else rig.findings(since)
    if findings:
        lines = "\n".join(f"  {line}" for line in findings)
        pytest.fail(f"the flight was not clean:\n{lines}\n{_ACCEPT}", pytrace=False)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Report the runs' folders, add the runs to JUnit, and remove the runs of passed tests."""
    rig = item.stash.get(_RIG, None)
    if rig is not None and call.when != "setup":
        item.user_properties += _properties(rig.runs, since=rig.reported)
        rig.reported = len(rig.runs)
    report = yield
    if rig is None:
        return report
    if report.failed:
        item.stash[_FAILED] = True
        if rig.runs:
            lines = [f"{run.json['status']}  digest {run.digest}  {run.out}" for run in rig.runs]
            command = f"again, with a report: hil run {rig.runs[-1].out}/bench.yaml"
            report.sections.append(("hil runs", "\n".join([*lines, command])))
    if call.when == "teardown" and not item.stash.get(_FAILED, False) and not item.config.getoption("--hil-keep"):
        _remove_runs(rig, Path(item.config.rootpath))
    return report


def _properties(runs: Sequence[Run], *, since: int) -> list[tuple[str, object]]:
    """Return JUnit properties that identify the flights from number `since` on; names count from the second flight."""
    properties: list[tuple[str, object]] = []
    for number, run in enumerate(runs[since:], start=since + 1):
        values = {
            "digest": run.digest,
            "rig": run.json["rig"],
            "seed": run.json["seed"],
            "verdict": run.json["status"],
            "out": str(run.out),
        }
        suffix = "" if number == 1 else f"_{number}"
        properties += [(f"hil_{key}{suffix}", value) for key, value in values.items()]
    return properties


def _remove_runs(rig: Rig, root: Path) -> None:
    """Remove the test's folder, and the folders above it that are then empty."""
    shutil.rmtree(rig.folder, ignore_errors=True)
    for folder in rig.folder.parents:
        if folder == root or root not in folder.parents:
            return
        try:
            folder.rmdir()
        except OSError:
            return


def _bench_file(item: pytest.Item) -> Path | None:
    """Return the bench file: --hil-config, else the nearest hil.yaml above the test, else None (the default bench)."""
    option = item.config.getoption("--hil-config")
    if option is not None:
        return Path(option)
    root = Path(item.config.rootpath)
    for folder in _upwards(item.path.parent, root):
        if (folder / "hil.yaml").is_file():
            return folder / "hil.yaml"
    return None


def _upwards(folder: Path, root: Path) -> Iterable[Path]:
    """Yield `folder` and the folders above it, up to `root`."""
    yield folder
    if root in folder.parents:
        for parent in folder.parents:
            yield parent
            if parent == root:
                return


def _rig_of(item: pytest.Item) -> tuple[str, frozenset[str]]:
    """Return the rig's name, and its hardware features together with its sensors' names and kinds."""
    from hil.config import load_bench
    from signals.errors import ConfigError

    try:
        bench = load_bench(
            _bench_file(item),
            rig=_rig_name(item),
            settings=(*item.config.getoption("--hil-set"), "mission="),
            flown=False,
        )
    except ConfigError as error:
        raise pytest.fail.Exception(f"the bench cannot be used:\n{error}", pytrace=False) from None
    features: set[str] = set()
    for config in [vehicle.config for vehicle in bench.vehicles.values()] or [bench.config]:
        features.update(config.features, config.sensors, (sensor.kind for sensor in config.sensors.values()))
    return bench.config.rig, frozenset(features)


def _rig_name(item: pytest.Item) -> str | None:
    option: str | None = item.config.getoption("--hil-rig")
    if option is not None:
        return option
    marker = item.get_closest_marker("rig")
    if marker is None:
        return None
    if len(marker.args) != 1 or not isinstance(marker.args[0], str):
        pytest.fail('write the rig\'s name: @pytest.mark.rig("mock")', pytrace=False)
    return marker.args[0]


def _allowed(item: pytest.Item) -> frozenset[str]:
    names = [name for marker in item.iter_markers("hil_allow") for name in marker.args]
    unknown = [name for name in names if name not in HEALTH]
    if unknown:
        pytest.fail(f"hil_allow: {unknown[0]!r} is none of {', '.join(HEALTH)}", pytrace=False)
    return frozenset(names)


# -- fixtures ---------------------------------------------------------------------------------------------------


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Rig:
    """The test's rig: `rig.fly(mission)` returns a `Run`."""
    item: pytest.Item = request.node
    config = request.config
    allowed = _allowed(item)
    name, features = _rig_of(item)
    # Parameter values may contain characters that folder names may not.
    parts = [re.sub(r"[^A-Za-z0-9_.-]+", "-", part)[:_NAME_LIMIT] for part in re.split(r"::|/", item.nodeid)]
    folder = Path(config.rootpath) / config.getoption("--hil-artifacts") / Path(*parts)
    shutil.rmtree(folder, ignore_errors=True)  # runs of an earlier session must not be mistaken for this one's
    rig = item.stash[_RIG] = Rig(
        name,
        features,
        _bench_file(item),
        folder,
        chosen_name=_rig_name(item),
        seed=config.getoption("--hil-seed"),
        settings=tuple(config.getoption("--hil-set")),
        allowed=allowed,
        report=config.getoption("--hil-keep"),
    )
    return rig


@pytest.fixture
def mission(request: pytest.FixtureRequest) -> Callable[[str], Path]:
    """Finder of mission files by name: beside the test, in `missions/`, then in the folders above, then the bench's."""

    def find(name: str) -> Path:
        for folder in _upwards(request.path.parent, Path(request.config.rootpath)):
            for candidate in (folder / name, folder / "missions" / name):
                if candidate.is_file():
                    return candidate
        import hil.own_packages  # noqa: F401 (before rigs, which may be a folder of the project, too)
        import rigs

        candidate = Path(rigs.__file__).parent / "missions" / name
        if not candidate.is_file():
            where = f"beside {request.path.name}, above it, or in the bench"
            pytest.fail(f"there is no mission {name!r} {where}", pytrace=False)
        return candidate

    return find


@pytest.fixture
def hil_desk() -> MockDesk:
    """Mocked USB bus, serial ports and HID devices, to which a test connects boards and gamepads."""
    from firmware_bridge.devices.mock_bus import MockDesk

    return MockDesk()


@pytest.fixture
def hil_usb_bus(hil_desk: MockDesk) -> MockUsbBus:
    """The USB bus of `hil_desk`."""
    return hil_desk.usb


@pytest.fixture
def hil_serial_ports(hil_desk: MockDesk) -> MockSerialPorts:
    """The serial ports of `hil_desk`."""
    return hil_desk.ports


@pytest.fixture
def hil_hid(hil_desk: MockDesk) -> MockHid:
    """The HID devices of `hil_desk`."""
    return hil_desk.hid
