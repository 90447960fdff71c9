"""`hil devices`: lists connected autopilots, serial ports and gamepads, and the obstacles to using them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence

from rich.console import Console
from rich.markup import escape

from firmware_bridge.autopilots.catalog import PROFILES
from firmware_bridge.codecs.mavlink_frame import FrameParser
from firmware_bridge.devices.inventory import (
    NO_PORT_ACCESS,
    Autopilot,
    Devices,
    Gamepad,
    find_devices,
    port_hint,
    usb_ids,
)
from firmware_bridge.devices.watch import Change, DeviceWatch
from firmware_bridge.links.px4.hitl_setup import HitlSetup, await_autopilot
from firmware_bridge.transports.serial import SerialTransport

_POLL_S = 0.5
_MOTORS = 4
_HEARTBEAT_S = 5.0

_NO_AUTOPILOT = (
    "none found. Is the cable a data cable (many only charge)? Does the board's light come on? On Linux, "
    "`sudo dmesg -w` shows whether the computer notices it; ModemManager may hold its port for half a minute."
)
_NO_GAMEPAD = (
    "none found. Set a radio to 'USB joystick', a Logitech pad's switch to D. Xbox pads on a cable are not HID on "
    "Linux and Windows: use Bluetooth. The keyboard can fly too."
)


def print_devices(
    console: Console,
    *,
    as_json: bool = False,
    watch: bool = False,
    find: Callable[[], Devices] = find_devices,
    wait: Callable[[float], None] = time.sleep,
    ended: Callable[[], bool] = lambda: False,
) -> None:
    """Print the inventory and, with `watch`, every change until Ctrl-C, or until `ended` returns True.

    `as_json` prints the inventory as one object and each change as one object on a line.
    """
    watcher = DeviceWatch(find)
    watcher.poll()
    if as_json:
        console.print_json(json.dumps(watcher.devices.as_json()), indent=None if watch else 2)
    else:
        _print_tables(console, watcher.devices)
    if not watch:
        return
    if not as_json:
        console.print("\nwatching for changes; Ctrl-C ends")
    try:
        while not ended():
            wait(_POLL_S)
            for event in watcher.poll():
                _print_event(console, event, as_json=as_json)
    except KeyboardInterrupt:
        return


def _print_event(console: Console, event: Change, *, as_json: bool) -> None:
    if as_json:
        key = _JSON_KEYS[event.kind]
        item = Devices(**{key: (event.item,)}).as_json()[key][0]  # type: ignore[arg-type]
        name = "unplugged" if event.unplugged else "plugged"
        console.print(json.dumps({"event": name, "kind": event.kind, "device": item}), markup=False, soft_wrap=True)
    else:
        console.print(f"{time.strftime('%H:%M:%S')}  {event}", markup=False, soft_wrap=True)


_JSON_KEYS = {"autopilot": "autopilots", "serial port": "ports", "gamepad": "gamepads"}


def _print_tables(console: Console, devices: Devices) -> None:
    _heading(console, "Autopilots")
    if devices.autopilots:
        _print_table(
            console,
            ("board", "USB ids", "serial number", "port", "firmware"),
            [row for a in devices.autopilots for row in _autopilot_rows(a)],
        )
        for a in devices.autopilots:
            for note in a.notes:
                _note(console, f"{a.product or a.board}: {note}")
        usable = next((a for a in devices.autopilots if a.port and a.ports[0].accessible), None)
        if usable is not None:
            rig, key = _rig_and_key(usable)
            _note(console, f"to fly with it: hil run --rig {rig} --set autopilot.{key}={usable.port}")
    else:
        _note(console, _NO_AUTOPILOT)
    _heading(console, "Other serial ports")
    if devices.ports:
        _print_table(
            console,
            ("port", "USB ids", "serial number", "description"),
            [(p.device, usb_ids(p) or "-", p.serial_number or "-", port_hint(p) or "-") for p in devices.ports],
        )
        # No autopilot is connected to a computer's own ttyS ports, so advice about them would be noise.
        inaccessible = ", ".join(p.device for p in devices.ports if not p.accessible and p.vendor_id is not None)
        if inaccessible:
            _note(console, NO_PORT_ACCESS.format(device=inaccessible))
    else:
        _note(console, "none found")
    _heading(console, "Gamepads and transmitters")
    if devices.gamepads:
        _print_table(
            console,
            ("name", "kind", "USB ids", "serial number", "path"),
            [(g.name, g.kind, usb_ids(g) or "-", g.serial_number or "-", _path_text(g)) for g in devices.gamepads],
        )
        for pad in devices.gamepads:
            for note in pad.notes:
                _note(console, f"{pad.name}: {note}")
    else:
        _note(console, _NO_GAMEPAD)
    for note in devices.notes:
        console.print(f"[yellow]note:[/] {escape(note)}", soft_wrap=True, markup=True)


def _rig_and_key(board: Autopilot) -> tuple[str, str]:
    """Return the rig, named as its kind of autopilot, for a board's first firmware, and the key of its USB port."""
    flown = {p.firmware.name: (kind, p.usb_port) for kind, p in PROFILES.items() if p.usb_port}
    return next(flown[firmware] for firmware in board.firmwares if firmware in flown)


def _autopilot_rows(a: Autopilot) -> list[tuple[str, ...]]:
    """Return a row for the board, and one more for each further port."""
    name = f"{a.product} ({a.board})" if a.product else a.board
    ports = [f"{port.device}{' (try first)' if port.device == a.port else ''}" for port in a.ports] or ["-"]
    firmware = "bootloader" if a.bootloader else " or ".join(a.firmwares)
    head = (name, usb_ids(a) or "-", a.serial_number or "-", ports[0], firmware)
    return [head, *(("", "", "", port, "") for port in ports[1:])]


def _path_text(pad: Gamepad) -> str:
    return pad.path.decode("utf-8", "replace")


def _heading(console: Console, text: str) -> None:
    console.print(f"[bold]{text}[/]", markup=True)


def _note(console: Console, text: str) -> None:
    console.print(f"  {text}", markup=False, soft_wrap=True)


def _print_table(console: Console, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table. Unlike rich's tables it neither wraps nor cuts cells, so that ids and paths can be copied."""
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        return "  " + "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()

    console.print(f"[dim]{escape(line(header))}[/]", soft_wrap=True, markup=True)
    for row in rows:
        console.print(line(row), markup=False, soft_wrap=True)


def check_board(console: Console, port: str, *, baud: int, fix: bool) -> bool:
    """Check the HITL setup of the board on `port`; with `fix`, correct it and restart the board.

    Returns True if the board is ready now. Raises LinkError if the port cannot be opened or no MAVLink device answers.
    """
    transport = SerialTransport(port, baud=baud)
    transport.open()
    try:
        parser = FrameParser()
        sysid = await_autopilot(transport, parser, limit_s=_HEARTBEAT_S)
        setup = HitlSetup(transport, parser, motors=_MOTORS, sysid=sysid)
        problems = setup.problems()
        for problem in problems:
            console.print(f"[yellow]wrong[/]  {escape(str(problem))}", markup=True)
        settable = {problem.name: problem.wanted for problem in problems if problem.found is not None}
        if not problems:
            console.print("[green]right[/]  SYS_HITL and the motors' outputs (HIL_ACT_FUNCn)", markup=True)
            if setup.commands_come():
                console.print(
                    "[green]right[/]  the board sends motor commands: the connection is fast enough", markup=True
                )
                return True
            console.print(
                "[yellow]wrong[/]  the board sends no HIL_ACTUATOR_CONTROLS: it was not restarted yet, or the "
                "connection is too slow",
                markup=True,
            )
        if fix and (settable or not problems):
            setup.set(settable)
            setup.reboot()
            console.print(f"set {', '.join(settable) or 'nothing'}; the board restarts. Check again in ten seconds.")
        elif not fix:
            console.print("to correct the setup and restart the board, run the same command with --fix")
        return False
    finally:
        transport.close()
