"""Client of the bench's companion link: lets a client under test (CUT) receive frames and command the vehicle.

Plain Python 3.8 or newer with numpy, pyzmq and msgpack, so that it runs on a companion computer's own Python.
A CUT is one function from a `Frame` to a `Desired` or None; `run` connects it to a bench.
"""

from hil_companion.desired import Desired
from hil_companion.detections import Detections, Found
from hil_companion.errors import CompanionError
from hil_companion.frame import Frame, Sample
from hil_companion.link.client import Client
from hil_companion.link.protocol import Welcome
from hil_companion.runner import run
from hil_companion.view import Grid, View

__all__ = [
    "Client",
    "CompanionError",
    "Desired",
    "Detections",
    "Found",
    "Frame",
    "Grid",
    "Sample",
    "View",
    "Welcome",
    "run",
]
