"""Recordings of episodes as MCAP files, for Foxglove and `ros2 bag`: the option `record_dir`.

An episode is a file `episode-N.mcap`; of environment K of a batch `environment-K-episode-N.mcap`, of one of several
vehicles `NAME-episode-N.mcap`. It holds the true state after each step, every sample of the observed ports, `reward`,
and `action/I` for each value of the action, with the topics and times of a run's recording (docs/recording.md). A file
is complete when the next episode begins or the environment is closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from hil.config import Bench
from hil.config.saved import resolved_yaml
from hil.gym.options import FlightOptions
from hil.gym.ports import Ports
from hil.run.recorder.mcap.mcap_file import SafeFile, open_unbuffered
from hil.run.recorder.mcap.mcap_sink import McapRecording, McapSink
from hil.run_files import BENCH_NAME
from signals.errors import file_errors
from signals.samples import Sample, ScalarSample, TruthState

_FLUSH_STEPS = 50


class Recorded(Protocol):
    """Vehicle whose flight is recorded."""

    @property
    def bench(self) -> Bench: ...

    @property
    def seed(self) -> int: ...

    @property
    def ports(self) -> Ports | None: ...

    @property
    def truth(self) -> TruthState: ...


class Recordings:
    """Open recordings of a batch; without `record_dir` it does nothing."""

    def __init__(self, options: FlightOptions, names: Sequence[str]) -> None:
        """`names`: of the rows, in the names of their files; "" for the only one."""
        self._folder = None if options.record_dir is None else Path(options.record_dir)
        self._heads = [f"{name}-" if name else "" for name in names]
        self._episodes: dict[int, int] = {}
        self._open: dict[int, _Episode] = {}

    def begin(self, row: int, flight: Recorded) -> None:
        """Begin the file of an episode. Raises RecordingError if it cannot be written."""
        if self._folder is None:
            return
        number = self._episodes.get(row, -1) + 1
        with file_errors(self._folder, "cannot be used as a folder"):
            self._folder.mkdir(parents=True, exist_ok=True)
        while (path := self._folder / f"{self._heads[row]}episode-{number}.mcap").exists():
            number += 1  # of an earlier session: nothing is written over
        self._episodes[row] = number
        self._open[row] = _Episode(path, flight)

    @property
    def any(self) -> bool:
        """True if an episode is being recorded."""
        return bool(self._open)

    def add(self, row: int, flight: Recorded, action: Sequence[float], reward: float) -> None:
        """Record a step of a row that is being recorded."""
        if row in self._open:
            self._open[row].step(flight, action, reward)

    def end(self, row: int) -> None:
        """Complete the file of a row."""
        episode = self._open.pop(row, None)
        if episode is not None:
            episode.close()


class _Episode:
    """File of one episode."""

    def __init__(self, path: Path, flight: Recorded) -> None:
        config = flight.bench.config
        self._recording = McapRecording(
            SafeFile(path, open_unbuffered),
            tick_ns=config.tick_ns,
            metadata={"rig": config.rig, "scene": flight.bench.scene.name, "seed": str(flight.seed)},
            attachments={BENCH_NAME: resolved_yaml(config).encode()},
        )
        self._sink = McapSink(self._recording.mcap, tick_ns=config.tick_ns)
        self._tick, self._steps = flight.truth.tick, 0
        self._is_open = True
        if flight.ports is not None:
            flight.ports.describe(self._sink.describe)
        self._sink.truth(flight.truth)
        if flight.ports is not None:
            flight.ports.listen(self._take)

    def step(self, flight: Recorded, action: Sequence[float], reward: float) -> None:
        truth = flight.truth
        self._tick, t_ns, seq = truth.tick, truth.t_ns, self._steps
        self._sink.truth(truth)
        self._sink.sample("reward", ScalarSample(seq, t_ns, t_ns, reward))
        for index, value in enumerate(action):
            self._sink.sample(f"action/{index}", ScalarSample(seq, t_ns, t_ns, value))
        self._steps += 1
        if self._steps % _FLUSH_STEPS == 0:
            self._sink.flush(self._tick)

    def _take(self, port: str, sample: Sample) -> None:
        if self._is_open:
            self._sink.sample(port, sample)

    def close(self) -> None:
        self._is_open = False
        self._sink.close(self._tick)
        self._recording.close(self._tick, {"status": "EPISODE", "steps": str(self._steps)})
