"""Detections over the real link: accepted from clients of the topic, refused from others, limited in size."""

from __future__ import annotations

from typing import Any

import pytest

from signals.detections import MAX_BOXES, MAX_OBJECTS
from tests.worlds.companion_server import RawClient, answered, frame_of, join, serving, step, until

BOX = ["person", 0.5, 1.0, 2.0, 3.0, 4.0, 12.5, None, [1.0, 2.0, 0.0]]
SEEN: dict[str, Any] = {"topic": "front/rgb", "t_capture_ns": 5, "size_px": [4, 3], "boxes": [BOX], "objects": None}


@pytest.mark.parametrize("arrangement", ["one_port", "shared_memory"])
def test_the_greatest_number_of_detections_passes_in_one_message(arrangement: str) -> None:
    place = {"bind": "ipc://*", "arrangement": arrangement} if arrangement == "shared_memory" else {}
    one = ["p" * 64, 2**61, [-123456.789] * 3, [-1.23456789] * 3, 10**6, 0.123456789]
    objects = [[i, *one] for i in range(MAX_OBJECTS)]
    box = ["p" * 64, 0.123456789, *[12345.6789] * 4, 123.456789, -12.3456789, [-123456.789] * 3]
    whole = SEEN | {"boxes": [box] * MAX_BOXES, "objects": objects}
    with serving(**place) as server, RawClient(server.endpoint) as client:
        join(server, client)
        server.send(frame_of(1))
        client.expect("frame")
        client.done(1, detections=whole)
        (reply,) = answered(server)
        assert reply.detections is not None
        assert (len(reply.detections.boxes), len(reply.detections.objects or ())) == (MAX_BOXES, MAX_OBJECTS)


@pytest.mark.parametrize(
    "wrong",
    [
        SEEN | {"topic": "imu"},  # not asked for
        SEEN | {"boxes": [[*BOX[:2], float("nan"), *BOX[3:]]]},
    ],
)
def test_invalid_detections_are_refused_and_the_client_goes_on(wrong: Any) -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client, topics=["front/rgb"])
        server.send(frame_of(1))
        client.expect("frame")
        client.done(1, detections=wrong)
        until(server, lambda: not client.silent(0.0))
        refused = client.expect("refused")
        assert refused["code"] == "malformed"
        assert "detections" in refused["text"]
        client.done(1, detections=SEEN)
        (reply,) = answered(server)
        assert reply.detections is not None
        assert reply.detections.boxes[0].p_W == (1.0, 2.0, 0.0)
        step(server, client, 2)
