"""Output of `hil bench` that is common to all benchmarks."""

from __future__ import annotations

import json
import subprocess
import sys
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from hil.apps.bench_suite import cases, suite
from hil.apps.bench_suite.result import BenchmarkResult, Check, Row
from signals.errors import ConfigError, RecordingError


def test_a_part_that_was_not_run_is_not_blamed_on_quick() -> None:
    console = Console(width=120, record=True, file=StringIO())
    suite._print(BenchmarkResult(left_out=["px4_sitl: the environment variable PX4_BINARY is not set"]), console)
    text = console.export_text()
    assert "left out: px4_sitl: the environment variable PX4_BINARY is not set" in text
    assert "--quick" not in text


def test_an_unknown_benchmark_names_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="known: airsim, dash"):
        suite.run_benchmarks("nonsense", json=None, quick=True, console=Console(quiet=True))


ROW = Row("case", "method", 1.0, "m", 1.0)
SLOW = Check("time", 9.0, "<=", 1.0, "s", "speed")
EXACT = Check("error", 0.0, "<=", 1.0, "m")
WRONG = Check("error", 2.0, "<=", 1.0, "m")


@pytest.fixture
def benchmarks(monkeypatch: pytest.MonkeyPatch) -> dict[str, SimpleNamespace]:
    """Benchmarks that a test defines: modules by name, in place of the real ones."""
    modules: dict[str, SimpleNamespace] = {}
    monkeypatch.setattr(suite, "import_case", modules.__getitem__)
    monkeypatch.setattr(suite, "benchmarks", lambda: {"one": "one", "two": "two"})
    return modules


def with_checks(*checks: Check) -> SimpleNamespace:
    return SimpleNamespace(TITLE="", measure=lambda quick, status: BenchmarkResult([ROW], list(checks)))


def run(name: str, *, errors_only: bool, out: Path | None = None, without: tuple[str, ...] = ()) -> tuple[bool, str]:
    console = Console(width=120, record=True, file=StringIO())
    met = suite.run_benchmarks(name, json=out, quick=True, console=console, errors_only=errors_only, without=without)
    return met, console.export_text()


def test_a_slow_machine_fails_no_check_of_error(benchmarks: dict[str, SimpleNamespace], tmp_path: Path) -> None:
    benchmarks["one"] = with_checks(SLOW, EXACT)
    assert not run("one", errors_only=False)[0]
    met, text = run("one", errors_only=True, out=tmp_path / "one.json")
    assert met
    assert "left out: checks of speed" in text
    (check,) = json.loads((tmp_path / "one.json").read_text())["checks"]
    assert check == vars(EXACT) | {"ok": True}


def test_errors_fail_wherever_they_are(benchmarks: dict[str, SimpleNamespace]) -> None:
    benchmarks |= {"one": with_checks(WRONG), "two": with_checks(EXACT)}
    assert not run("one", errors_only=True)[0]
    met, text = run("all", errors_only=True)
    assert not met
    assert text.rstrip().endswith("1 of 2 benchmarks met every check\nNOT MET one: error: 2, not <= 1 m")
    benchmarks["one"] = with_checks(EXACT)
    met, text = run("all", errors_only=True)
    assert met
    assert text.rstrip().endswith("2 of 2 benchmarks met every check")
    benchmarks["one"] = with_checks(SLOW)
    assert not run("one", errors_only=True)[0], "nothing was checked"
    assert run("all", errors_only=True)[1].rstrip().endswith("NOT MET one: no check was made")


def test_what_this_machine_cannot_run_is_named_and_left_out_of_all(benchmarks: dict[str, SimpleNamespace]) -> None:
    benchmarks |= {"one": with_checks(WRONG), "two": with_checks(EXACT)}
    benchmarks["one"].missing = lambda: "needs the package x"
    met, text = run("all", errors_only=True)
    assert met
    assert "left out: needs the package x" in text
    benchmarks["two"].missing = lambda: "needs the package y"
    assert not run("all", errors_only=True)[0], "nothing was run"


INSTALLED = ("lockstep", "link", "physics", "radar", "raster", "stability")


def test_benchmarks_by_which_a_user_trusts_his_machine_are_installed() -> None:
    assert sorted(n for n, module in cases.benchmarks().items() if module.startswith("hil.")) == sorted(INSTALLED)


def test_a_benchmark_is_one_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "lab/drop").mkdir(parents=True)
    (tmp_path / "lab/drop/drop.py").write_text('"""Fall."""\n\nTITLE = "Drop: error against time"\n')
    (tmp_path / "lab/drop/cases.py").write_text('"""Not TITLE = "a benchmark"."""\n')
    monkeypatch.setattr(cases, "_CHECKOUT", tmp_path)
    found = cases.benchmarks.__wrapped__()
    assert found.pop("drop") == "lab.drop.drop"
    assert tuple(found) == tuple(sorted(INSTALLED))


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The folder `lab` of a checkout with one benchmark, `drop`."""
    (tmp_path / "pyproject.toml").touch()
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / "drop.py").write_text('TITLE = "Drop"\n')
    monkeypatch.setattr(cases, "_CHECKOUT", tmp_path)
    return folder


def test_a_file_that_cannot_be_read_hinders_no_benchmark(lab: Path) -> None:
    (lab / ".#drop.py").symlink_to("user@host.1:2")  # the lock of an editor
    (lab / "gone.py").symlink_to("nothing.py")
    (lab / ".fall.py").write_text('TITLE = "Hidden"\n')
    (lab / ".old").mkdir()
    (lab / ".old/drop.py").write_text('TITLE = "Hidden"\n')
    (lab / "latin.py").write_bytes('TITLE = "Höhe"\n'.encode("latin-1"))
    (lab / "folder.py").mkdir()
    assert set(cases.benchmarks.__wrapped__()) == {"drop", *INSTALLED}


@pytest.mark.parametrize("name", ["link", "drop"])
def test_two_benchmarks_of_one_name_are_refused(name: str, lab: Path) -> None:
    (lab / "more").mkdir()
    second = lab / f"more/{name}.py"
    second.write_text('TITLE = "Other"\n')
    with pytest.raises(ConfigError) as refused:
        cases.benchmarks.__wrapped__()
    first = Path(cases.__file__).parent / "link/link.py" if name == "link" else lab / "drop.py"
    assert f"{second}: is a second benchmark {name!r}, beside {first}" in str(refused.value)


def test_an_installed_package_says_which_benchmarks_need_a_checkout(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab/airsim.py").touch()  # another package's: packages are installed beside each other
    monkeypatch.setattr(cases, "_CHECKOUT", tmp_path)
    monkeypatch.setattr(suite, "benchmarks", cases.benchmarks.__wrapped__)
    for name, hint in (("dash", "known: link, lockstep"), ("phisics", "did you mean 'physics'")):
        words = rf"no benchmark '{name}' of this installation; a further one needs a checkout .*{hint}"
        for named, without in ((name, ()), ("all", (name,))):
            with pytest.raises(ConfigError, match=words):
                run(named, errors_only=True, without=without)
    monkeypatch.setattr(suite, "_run", lambda *_, **__: BenchmarkResult([ROW], [EXACT]))
    met, text = run("all", errors_only=True)
    assert met
    assert "left out: lab/, which needs a checkout" in text
    assert [name for name in cases.benchmarks() if f"hil bench {name} " in text] == sorted(INSTALLED)


def test_cases_of_the_lab_are_found_from_any_folder(tmp_path: Path) -> None:
    code = "from hil.apps.bench_suite import cases\nprint(cases.import_case(cases.benchmarks()['vehicles']).__file__)\n"
    done = subprocess.run([sys.executable, "-P", "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(Path(__file__).resolve().parents[5] / "lab/vehicles.py")


def test_what_is_left_out_by_name_is_named(benchmarks: dict[str, SimpleNamespace]) -> None:
    benchmarks |= {"one": with_checks(WRONG), "two": with_checks(EXACT)}
    met, text = run("all", errors_only=True, without=("one",))
    assert met
    assert "left out: --without" in text
    with pytest.raises(ConfigError, match="no benchmark 'three'"):
        run("all", errors_only=True, without=("three",))
    with pytest.raises(ConfigError, match="'hil bench all' alone"):
        run("two", errors_only=True, without=("one",))


def test_all_has_no_file_of_its_own(benchmarks: dict[str, SimpleNamespace], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="neither --json nor --set"):
        run("all", errors_only=True, out=tmp_path / "all.json")


def test_a_result_that_cannot_be_written_is_told_before_measuring(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[bool] = []

    def measure(*, quick: bool, status: object) -> BenchmarkResult:
        measured.append(quick)
        return BenchmarkResult()

    monkeypatch.setattr(suite, "import_case", lambda _: SimpleNamespace(TITLE="", measure=measure))
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match=r"rows\.json: cannot be written"):
        suite.run_benchmarks("link", json=tmp_path / "file/rows.json", quick=True, console=Console(file=StringIO()))
    assert measured == []
