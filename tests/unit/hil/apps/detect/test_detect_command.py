"""`hil detect` on the command line: its needs, and its messages where they are missing."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from hil.apps.detect.command import TrainingData, overlap_notes
from hil.apps.detect.data_sets import SCENES, DataSetSeries, plan
from hil.apps.detect.pictures import read_data_sets, with_smallest
from hil.cli.app import run_command_line
from signals.errors import ConfigError
from tests.worlds.labelled_pictures import write_data_set

FRAMES = [[("person", (10, 20, 14, 34))]] * 5


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_data_set(tmp_path / "set", FRAMES)  # type: ignore[arg-type]


def said(capsys: pytest.CaptureFixture[str]) -> str:
    output = capsys.readouterr()
    return " ".join((output.out + output.err).split())


def test_training_without_pytorch_says_what_to_install(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    for name in [
        n for n in sys.modules if n.startswith("hil.apps.detect.") and n.split(".")[-1] in ("train", "export")
    ]:
        monkeypatch.delitem(sys.modules, name)
    assert run_command_line(["detect", "train", str(folder), "--out", str(tmp_path / "out")]) == 2
    text = said(capsys)
    assert "needs PyTorch" in text
    assert "hil-bench[train]" in text
    assert "Traceback" not in text


def test_pictures_that_train_and_judge_are_told(folder: Path, tmp_path: Path) -> None:
    other = write_data_set(tmp_path / "other", FRAMES)  # type: ignore[arg-type]

    def notes(**given: Any) -> list[str]:
        pictures, validation, test = TrainingData([folder], **given).read()
        return overlap_notes(pictures, validation=validation, test=test)

    assert notes() == notes(part="all", validation=[other]) == []
    (told,) = notes(part="all", validation=[other], test=[folder])
    assert told.startswith("test: 5 of 5 pictures are trained on, too")
    (told,) = notes(validation=[folder])  # the whole of it: what `--part train` takes is in it
    assert told.startswith("validation: 3 of 5 pictures are trained on, too")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["SET", "--weights", "missing.onnx"], "missing.onnx: cannot be read"),
        (["SET", "--weights", "weights.pt"], "a .onnx file"),
        (["nowhere"], "there is no such folder"),
        (["SET", "--part", "some"], "is not a set of pictures"),
        (["SET", "--backend", "magic"], "there are opencv, onnxruntime, pytorch"),
    ],
)
def test_data_that_cannot_be_judged_are_refused(
    folder: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [str(folder) if a == "SET" else a for a in arguments]
    assert run_command_line(["detect", "evaluate", *given, "--quiet"]) == 2
    text = said(capsys)
    assert words in text
    assert "Traceback" not in text


def test_series_of_data_sets_are_spread_and_repeat() -> None:
    plans = [plan(i, 1000) for i in range(120)]
    assert plans == [plan(i, 1000) for i in range(120)]
    assert len({p.seed for p in plans}) == len({p.name for p in plans}) == 120
    assert {p.scene for p in plans} == set(SCENES)
    low = [p for p in plans if p.height_m < 6.3]
    assert 40 <= len(low) <= 80  # even in the logarithm
    assert all(2.0 <= p.height_m <= 20.0 and 0.0 <= p.pitch_deg <= 90.0 for p in plans)
    for scene in SCENES:
        assert len({p.course for p in plans if p.scene == scene}) == 4
        assert len({p.quality for p in plans if p.scene == scene}) == 3
    assert all(plan(i, 900_000).seed not in {p.seed for p in plans} for i in range(40))


def test_a_series_can_be_larger_and_of_one_quality() -> None:
    plain, large = DataSetSeries(24, 1, 1000), DataSetSeries(24, 1, 1000, size_px=(640, 480), quality="high")
    assert plain.settings() == []
    assert large.settings() == ["sensors.front.resolution=[640, 480]"]
    assert {p.quality for p in large.plans()} == {"high"}
    assert {p.quality for p in plain.plans()} == {"low", "medium", "high"}
    with pytest.raises(ConfigError, match="did you mean 'high'"):
        DataSetSeries(24, 1, 1000, quality="hihg")
    assert [p.settings() for p in large.plans()] == [p.settings() for p in plain.plans()]


def test_smaller_objects_do_not_count_if_asked(folder: Path) -> None:
    pictures = read_data_sets([folder])
    areas = [p.area_px for p in pictures]
    assert not any(p.difficult.any() for p in with_smallest(pictures, 64))
    for p, area in zip(with_smallest(pictures, float(areas[0].max()) + 1.0), areas, strict=True):
        assert p.difficult.all()
        assert (p.area_px == area).all()


def test_an_input_of_another_size_must_fit_the_strides(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["detect", "train", str(folder), "--out", str(tmp_path / "out"), "--input", "480", "360"]
    assert run_command_line(arguments) == 2
    assert "--input: must be two multiples of 16, not 480 360" in said(capsys)
