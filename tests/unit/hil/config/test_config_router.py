"""The section `router` of a bench file."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from firmware_bridge.router.router import Endpoint
from hil.config.schema import Router


def test_endpoints_come_in_order_with_their_names() -> None:
    router = Router(
        companion="udpin:127.0.0.1:14560", gcs="udp:127.0.0.1:14550", more=("tcp:127.0.0.1:5790", "udp:10.0.0.2:14551")
    )
    assert router.endpoints() == [
        Endpoint(("127.0.0.1", 14550), name="gcs"),
        Endpoint(None, ("127.0.0.1", 14560), name="companion"),
        Endpoint(None, ("127.0.0.1", 5790), tcp=True, name="client"),
        Endpoint(("10.0.0.2", 14551), ("", 0), name="client"),
    ]


@pytest.mark.parametrize("key", ["gcs", "sdk", "companion", "more"])
@pytest.mark.parametrize("address", ["localhost", "udp:127.0.0.1:0", "udp:127.0.0.1:70000", "tcp::5760", "serial:a:1"])
def test_a_wrong_address_is_refused(key: str, address: str) -> None:
    with pytest.raises(ValidationError, match="must look like"):
        Router(**{key: (address,) if key == "more" else address})
