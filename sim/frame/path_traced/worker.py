"""Child process of the path tracer: `python -m sim.frame.path_traced.worker FD`, with a socket as file FD.

It holds Mitsuba, Dr.Jit and LLVM, so that an abort in one of them ends this process only. Every request is a tuple of a
name and its arguments; every answer is ("ok", result), ("missing", text) or ("error", text).
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from sim.frame.path_traced.protocol import LensData, RenderRequest, StartRequest
from sim.frame.path_traced.tone import to_srgb

_TILE_PIXELS = 1 << 20  # traced at once


class Worker:
    """Scene and cameras of one client."""

    def __init__(self, start: StartRequest) -> None:
        import drjit as dr
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")
        dr.set_thread_count(start.threads)
        import mitsuba_oidn

        from sim.frame.path_traced.sky import make_sky

        self._denoise: Callable[..., Any] = mitsuba_oidn.denoise
        self._sky = make_sky(start.sky)  # compiles a first kernel: an LLVM that does not fit ends the process here
        self._tracer: Any = None
        self._lenses: dict[int, LensData] = {}

    def load(self, message: dict[str, Any]) -> None:
        """Load the scene."""
        from sim.frame.path_traced.tracer import Tracer

        self._tracer = Tracer(message, self._sky)

    def lens(self, number: int, lens: LensData) -> None:
        """Store a camera under a number."""
        self._lenses[number] = lens

    def render(self, request: RenderRequest) -> np.ndarray:
        """Return a picture (height, width, 3) in sRGB codes."""
        lens, sky = self._lenses[request.lens], self._sky
        self._tracer.place(*request.moving)
        step = max(1, _TILE_PIXELS // lens.width)
        tiles = [
            self._tracer.render(
                lens,
                request.exposure,
                samples=request.samples,
                seed=request.seed,
                textures=request.textures,
                rows=(first, min(first + step, lens.height)),
            )
            for first in range(0, lens.height, step)
        ]
        light, albedo, normal = (np.concatenate(parts) for parts in zip(*tiles, strict=True))
        # The denoiser's own scale is a sum whose order depends on the number of threads.
        clean = np.asarray(self._denoise(light, albedo, normal, hdr=True, input_scale=1.0 / sky.white))
        return to_srgb(clean, sky.white, sky.balance * np.array(request.gain))

    def cpu_s(self) -> float:
        """Return the processor time of this process so far, in seconds."""
        return time.process_time()

    def surfaces(self, request: RenderRequest) -> tuple[np.ndarray, np.ndarray]:
        """Return geom and distance at the pixels' centres."""
        self._tracer.place(*request.moving)
        result: tuple[np.ndarray, np.ndarray] = self._tracer.surfaces(self._lenses[request.lens], request.exposure)
        return result


def serve(connection: Connection) -> None:
    """Answer requests until the client closes the connection."""
    worker: Worker | None = None
    while True:
        try:
            name, *arguments = connection.recv()
        except (EOFError, OSError):
            return
        answer: tuple[str, Any]
        try:
            if name == "start":
                worker = Worker(*arguments)
                answer = ("ok", None)
            else:
                assert worker is not None
                answer = ("ok", getattr(worker, name)(*arguments))
        except ImportError as error:
            answer = ("missing", f"{error}")
        except MemoryError:
            answer = ("error", "it has no memory left")
        except Exception as error:  # noqa: BLE001 - whatever it is, the client names it
            traceback.print_exc()
            answer = ("error", f"{type(error).__name__}: {error}")
        try:
            connection.send(answer)
        except OSError:
            return


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
