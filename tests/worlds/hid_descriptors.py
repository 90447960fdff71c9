"""HID report descriptors for tests, put together item by item."""


def item(tag_and_type: int, value: int, size: int | None = None) -> bytes:
    """Return a short item. `tag_and_type` is the prefix with size bits zero."""
    if size is None:
        size = 1 if -128 <= value <= 255 else 2 if -32768 <= value <= 65535 else 4
    code = {0: 0, 1: 1, 2: 2, 4: 3}[size]
    return bytes((tag_and_type | code,)) + (value & (1 << 8 * size) - 1).to_bytes(size, "little")


PAGE, LOW, HIGH, SIZE, ID, COUNT, PUSH, POP = 0x04, 0x14, 0x24, 0x74, 0x84, 0x94, 0xA4, 0xB4
USAGE, FIRST, LAST = 0x08, 0x18, 0x28
INPUT, OUTPUT, COLLECTION, END = 0x80, 0x90, 0xA0, 0xC0


def items(*pairs: tuple[int, int]) -> bytes:
    return b"".join(item(kind, value, 0 if kind in (PUSH, POP, END) else None) for kind, value in pairs)


def axes(*usages: int, low: int, high: int, bits: int) -> bytes:
    return items(
        (PAGE, 1),
        *((USAGE, usage) for usage in usages),
        (LOW, low),
        (HIGH, high),
        (SIZE, bits),
        (COUNT, len(usages)),
        (INPUT, 2),
    )


def buttons(count: int) -> bytes:
    return items((PAGE, 9), (FIRST, 1), (LAST, count), (LOW, 0), (HIGH, 1), (SIZE, 1), (COUNT, count), (INPUT, 2))


def padding(bits: int) -> bytes:
    return items((SIZE, bits), (COUNT, 1), (INPUT, 3))


def gamepad(*parts: bytes) -> bytes:
    return items((PAGE, 1), (USAGE, 5), (COLLECTION, 1)) + b"".join(parts) + items((END, 0))


# Four 8-bit sticks, a hat, 12 buttons: 7 bytes.
SIMPLE = gamepad(
    axes(0x30, 0x31, 0x32, 0x35, low=0, high=255, bits=8), axes(0x39, low=0, high=7, bits=4), buttons(12), padding(8)
)


EDGETX = gamepad(buttons(24), axes(0x30, 0x31, 0x32, 0x33, 0x34, 0x35, 0x36, 0x36, low=0, high=2047, bits=16))


def simple_report(x: int = 128, y: int = 128, z: int = 128, rz: int = 128, *pressed: int, hat: int = 8) -> bytes:
    """Return a report in the layout of SIMPLE."""
    bits = hat | sum(1 << 3 + button for button in pressed)
    return bytes((x, y, z, rz)) + bits.to_bytes(3, "little")
