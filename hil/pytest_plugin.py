"""A pytest plugin: fly missions from tests, and hold every flight against the bench's own health.

    @pytest.mark.rig("mock")                 # or --hil-rig on the command line, which wins
    @pytest.mark.hil_feature("gps")          # skipped, and said why, where the rig has none
    def test_hover(rig, mission):
        run = rig.fly(mission("hover.plan"), seed=3)
        assert run.passed, run.reasons
        assert run.max_cross_track_m < 1.0

A test that flew fails, although its own assertions hold, if a flight of it was not clean: a CRC error, bytes that
belong to no frame, a frame that was dropped, a late sample, an estimator that was reset in the air. A flight that ends
as ERROR raises `BenchError` at once. `@pytest.mark.hil_allow("late")` declares what a test expects to see; the words
are those of `HEALTH`.

What a flight left behind (run.json, the recordings, a bench.yaml that flies it again) is kept where the test failed,
under `--hil-artifacts`, and removed where it passed. JUnit files carry each flight's digest, rig, seed and verdict.

Tests that use none of this are untouched; the bench itself is imported when a test first asks for it.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from hil.flown_run import HEALTH, BenchError, Run, health

if TYPE_CHECKING:
    from firmware_bridge.devices.mock_bus import MockDesk, MockHid, MockSerialPorts, MockUsbBus

_MARKERS = (
    "rig(name): the rig to fly on; --hil-rig wins",
    "hil_feature(name, ...): skipped where the rig has no such hardware feature or sensor",
    f"hil_allow(what, ...): what a flight may show besides a clean link: {', '.join(HEALTH)}",
)
_NAME_LIMIT = 100


@dataclass(repr=False)
class Rig:
    """The rig of one test. Every flight lands in a folder of its own and is looked at when the test ends."""

    name: str
    features: frozenset[str]
    bench_file: Path | None
    folder: Path
    chosen: str | None = None  # by marker or option; None: the bench file's own
    seed: int | None = None
    settings: tuple[str, ...] = ()
    allowed: frozenset[str] = frozenset()
    report: bool = False
    runs: list[Run] = field(default_factory=list)

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
        """Fly `mission` (default: the bench file's) and return the run, whether it is a PASS or a FAIL.

        `settings` are texts as of `--set`. Raises BenchError where the run is an ERROR (unless the test allows
        it), and fails the test with every problem where the files are wrong.
        """
        from hil.bench import run_bench
        from hil.config import load_bench
        from hil.signals.errors import ConfigError

        # The report costs more than a short flight; `hil run OUT/bench.yaml` makes it from a run that was kept.
        report = () if self.report else ("record.report=false",)
        try:
            bench = load_bench(
                self.bench_file,
                rig=self.chosen,
                scene=scene,
                mission=None if mission is None else str(mission),
                seed=self.seed if self.seed is not None else seed,
                settings=(*report, *settings, *self.settings),
            )
        except ConfigError as error:
            wrong = f"the bench cannot be flown:\n{error}"
            raise pytest.fail.Exception(wrong, pytrace=False) from None
        result = run_bench(bench, self.folder / f"run-{len(self.runs) + 1}", quiet=True)
        run = Run(result.run, result.out)
        self.runs.append(run)
        if (run.json["error"] or {}).get("type") == "Interrupted":
            raise KeyboardInterrupt  # the bench has closed its recordings; now pytest may stop, too
        if run.status == "ERROR" and "error" not in self.allowed:
            raise BenchError(run)
        return run

    def complaints(self) -> list[str]:
        """What was not clean in the flights so far and is not allowed, in words."""
        found = []
        for number, run in enumerate(self.runs, start=1):
            which = f"run {number}: " if len(self.runs) > 1 else ""
            for what, count in health(run).items():
                if count and what not in self.allowed:
                    found.append(f"{which}{what}: {count} ({HEALTH[what]})")
        return found


# -- options and markers ----------------------------------------------------------------------------------------


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("hil", "hardware-in-the-loop bench")
    group.addoption("--hil-rig", metavar="RIG", help="fly every test on this rig, whatever its marker says")
    group.addoption("--hil-config", metavar="FILE", help="bench file; default: the hil.yaml nearest to the test")
    group.addoption("--hil-seed", metavar="N", type=int, help="fly every test with this seed")
    group.addoption("--hil-set", metavar="KEY=VALUE", action="append", default=[], help="override any key of the bench")
    group.addoption(
        "--hil-artifacts", metavar="DIR", default="hil-artifacts", help="where the runs of failed tests are kept"
    )
    group.addoption("--hil-keep", action="store_true", help="keep every run, with its report")


def pytest_configure(config: pytest.Config) -> None:
    for line in _MARKERS:
        config.addinivalue_line("markers", line)


_RIG = pytest.StashKey[Rig]()
_FAILED = pytest.StashKey[bool]()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip where a feature is missing, before any fixture costs time."""
    wanted = [name for marker in item.iter_markers("hil_feature") for name in marker.args]
    if not wanted:
        return
    name, features = _rig_of(item)
    missing = [feature for feature in dict.fromkeys(wanted) if feature not in features]
    if missing:
        has = ", ".join(sorted(features)) or "nothing"
        pytest.skip(f"rig {name!r} has no {' and no '.join(missing)}; it has: {has}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """After a test that held: were its flights clean? Here and not at teardown, so that it counts as a failure."""
    outcome = yield
    rig = item.stash.get(_RIG, None)
    if rig is not None:
        complaints = rig.complaints()
        if complaints:
            lines = "\n".join(f"  {line}" for line in complaints)
            allow = 'declare what is expected: @pytest.mark.hil_allow("late", ...)'
            pytest.fail(f"the flight was not clean:\n{lines}\n{allow}", pytrace=False)
    return outcome


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Say where the runs are, write them into JUnit, and clear away those of tests that passed."""
    rig = item.stash.get(_RIG, None)
    if rig is not None and call.when == "call":
        item.user_properties += _properties(rig.runs)
    report = yield
    if rig is None:
        return report
    if report.failed:
        item.stash[_FAILED] = True
        if rig.runs:
            lines = [f"{run.status}  digest {run.digest}  {run.out}" for run in rig.runs]
            again = f"again, with a report: hil run {rig.runs[-1].out}/bench.yaml"
            report.sections.append(("hil runs", "\n".join([*lines, again])))
    if call.when == "teardown" and not item.stash.get(_FAILED, False) and not item.config.getoption("--hil-keep"):
        _clear(rig, Path(item.config.rootpath))
    return report


def _properties(runs: Sequence[Run]) -> list[tuple[str, object]]:
    """For JUnit: what identifies each flight. The first one's names are plain, the others' are numbered."""
    found: list[tuple[str, object]] = []
    for number, run in enumerate(runs, start=1):
        values = {
            "digest": run.digest,
            "rig": run.json["rig"],
            "seed": run.json["seed"],
            "verdict": run.status,
            "out": str(run.out),
        }
        suffix = "" if number == 1 else f"_{number}"
        found += [(f"hil_{key}{suffix}", value) for key, value in values.items()]
    return found


def _clear(rig: Rig, root: Path) -> None:
    """Remove the test's folder, and those above it that it leaves empty."""
    shutil.rmtree(rig.folder, ignore_errors=True)
    for folder in rig.folder.parents:
        if folder == root or root not in folder.parents:
            return
        try:
            folder.rmdir()
        except OSError:
            return


def _bench_file(item: pytest.Item) -> Path | None:
    """The bench file: named, else the hil.yaml nearest above the test, else the installation's (None)."""
    named = item.config.getoption("--hil-config")
    if named is not None:
        return Path(named)
    root = Path(item.config.rootpath)
    for folder in _upwards(item.path.parent, root):
        if (folder / "hil.yaml").is_file():
            return folder / "hil.yaml"
    return None


def _upwards(folder: Path, root: Path) -> Iterable[Path]:
    """`folder`, then those above it, as far as the project goes."""
    yield folder
    if root in folder.parents:
        for parent in folder.parents:
            yield parent
            if parent == root:
                return


def _rig_of(item: pytest.Item) -> tuple[str, frozenset[str]]:
    """The rig's name and what it has: its hardware features, and its sensors by name and by kind."""
    from hil.config import load_bench
    from hil.signals.errors import ConfigError

    try:
        config = load_bench(
            _bench_file(item), rig=_rig_name(item), settings=(*item.config.getoption("--hil-set"), "mission=")
        ).config
    except ConfigError as error:
        raise pytest.fail.Exception(f"the bench cannot be used:\n{error}", pytrace=False) from None
    kinds = [sensor.kind for sensor in config.sensors.values()]
    return config.rig, frozenset((*config.features, *config.sensors, *kinds))


def _rig_name(item: pytest.Item) -> str | None:
    named: str | None = item.config.getoption("--hil-rig")
    if named is not None:
        return named
    marker = item.get_closest_marker("rig")
    if marker is None:
        return None
    if len(marker.args) != 1 or not isinstance(marker.args[0], str):
        pytest.fail('write the rig\'s name: @pytest.mark.rig("mock")', pytrace=False)
    return marker.args[0]


def _allowed(item: pytest.Item) -> frozenset[str]:
    words = [word for marker in item.iter_markers("hil_allow") for word in marker.args]
    unknown = [word for word in words if word not in HEALTH]
    if unknown:
        pytest.fail(f"hil_allow: {unknown[0]!r} is none of {', '.join(HEALTH)}", pytrace=False)
    return frozenset(words)


# -- fixtures ---------------------------------------------------------------------------------------------------


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Rig:
    """The rig this test flies on: `rig.fly(mission)` returns a `Run`."""
    item: pytest.Item = request.node
    config = request.config
    allowed = _allowed(item)
    name, features = _rig_of(item)
    # A parameter's value may hold anything; a folder's name may not.
    parts = [re.sub(r"[^A-Za-z0-9_.-]+", "-", part)[:_NAME_LIMIT] for part in re.split(r"::|/", item.nodeid)]
    folder = Path(config.rootpath) / config.getoption("--hil-artifacts") / Path(*parts)
    shutil.rmtree(folder, ignore_errors=True)  # what an earlier session left must not pass for this one's
    made = item.stash[_RIG] = Rig(
        name,
        features,
        _bench_file(item),
        folder,
        chosen=_rig_name(item),
        seed=config.getoption("--hil-seed"),
        settings=tuple(config.getoption("--hil-set")),
        allowed=allowed,
        report=config.getoption("--hil-keep"),
    )
    return made


@pytest.fixture
def mission(request: pytest.FixtureRequest) -> Callable[[str], Path]:
    """Finds mission files by name: beside the test, in `missions/` there, and so on upwards; then the bench's own."""

    def find(name: str) -> Path:
        for folder in _upwards(request.path.parent, Path(request.config.rootpath)):
            for candidate in (folder / name, folder / "missions" / name):
                if candidate.is_file():
                    return candidate
        import rigs

        candidate = Path(rigs.__file__).parent / "missions" / name
        if not candidate.is_file():
            where = f"beside {request.path.name}, above it, or in the bench"
            pytest.fail(f"there is no mission {name!r} {where}", pytrace=False)
        return candidate

    return find


@pytest.fixture
def hil_desk() -> MockDesk:
    """A mocked USB, serial ports and HID to plug boards and gamepads into by program."""
    from firmware_bridge.devices.mock_bus import MockDesk

    return MockDesk()


@pytest.fixture
def hil_usb_bus(hil_desk: MockDesk) -> MockUsbBus:
    """The USB of `hil_desk`."""
    return hil_desk.usb


@pytest.fixture
def hil_serial_ports(hil_desk: MockDesk) -> MockSerialPorts:
    """The serial ports of `hil_desk`."""
    return hil_desk.ports


@pytest.fixture
def hil_hid(hil_desk: MockDesk) -> MockHid:
    """The HID of `hil_desk`."""
    return hil_desk.hid
