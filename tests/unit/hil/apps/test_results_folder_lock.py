"""Two commands that write into one folder: the second ends with one message and changes nothing there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hil.cli.app import run_command_line
from hil.run.report.run_folder import locked_folder
from sim.radar.recording import Recording, save_recording
from tests.worlds.labelled_pictures import write_data_set
from tests.worlds.radar_recordings import frames_of, recording_of, truth

PEOPLE = [[("person", (10 + i, 20, 14, 34))] for i in range(5)]


def recording() -> Recording:
    """Return ten frames of three receivers, the last two of which are alike."""
    two = recording_of(frames_of(truth(), 10))
    return replace(two, adc=np.ascontiguousarray(two.adc[:, [0, 1, 1]]), rx_antennas=(1, 2, 3))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "needs"),
    [
        (["radar", "r.npz", "--out", "out"], "numpy"),
        (["calibrate", "radar", "r.npz", "--out", "out/mine.yaml"], "numpy"),
        (["detect", "train", "set", "--out", "out", "--epochs", "1", "--min-objects", "1"], "torch"),
    ],
    ids=lambda value: "-".join(value[:2]) if isinstance(value, list) else "",
)
def test_a_second_command_is_refused(
    arguments: list[str],
    needs: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip(needs, reason="needs PyTorch")
    monkeypatch.chdir(tmp_path)
    save_recording(tmp_path / "r.npz", recording())
    write_data_set(tmp_path / "set", PEOPLE)  # type: ignore[arg-type]
    with locked_folder(tmp_path / "out"):
        assert run_command_line(arguments) == 3
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
    assert "another run is writing here" in line
    assert not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize("arguments", [["radar", "r.npz", "--out", "out"]])
def test_the_folder_is_free_afterwards(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    save_recording(tmp_path / "r.npz", recording())
    result = tmp_path / "out" / "radar.npz"
    result.parent.mkdir()
    result.write_bytes(b"an earlier result")
    assert run_command_line(arguments) == 0
    assert result.read_bytes() != b"an earlier result"
    with locked_folder(result.parent):
        pass
