"""Check the CAN buses: SocketCAN and udp_multicast, each tried with a frame.

Frames are sent only where no car can receive them: on a virtual CAN interface, and to a separate multicast group.
"""

from __future__ import annotations

import errno
import os
import platform
import socket
import struct
from pathlib import Path

from codegen.doctor import Finding, State
from codegen.errors import CodegenError, one_line

FRAME_ID = 0x1FFF_FFFF
"""Extended identifier of the lowest priority; no message of a build uses it."""
EXTENDED = 0x8000_0000  # CAN_EFF_FLAG of linux/can.h
WAIT = 2.0
"""Timeout in s for a frame within this machine."""

SOCKETCAN, MULTICAST = "SocketCAN", "udp_multicast"
SERVES = {
    SOCKETCAN: "--bus socketcan:vcan0 and --ecu native",
    MULTICAST: "--bus udp_multicast:239.74.163.2, which needs no CAN in the kernel",
}
GROUP = "239.74.163.97"
"""Multicast group in the range for local use (RFC 2365); differs from that of the examples."""

OTHERWISE = "use --bus udp_multicast:239.74.163.2, or make evidence PART=vcan for a guest with CAN"

NETWORK = Path("/sys/class/net")
MODULES = Path("/lib/modules")
ARPHRD_CAN = "280"  # linux/if_arp.h
IFF_UP = 1  # linux/if.h


def socketcan(network: Path = NETWORK) -> Finding:
    """Check that CAN sockets exist, a virtual interface is up, and a frame passes from one socket to another."""
    if not hasattr(socket, "AF_CAN"):
        return _no_socketcan(f"{platform.system()} has no CAN sockets", OTHERWISE)
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return _refused(error)
    interfaces = [path.name for path in sorted(network.iterdir()) if _read(path / "type") == ARPHRD_CAN]
    virtual = [name for name in interfaces if name.startswith("vcan")]
    if not virtual:
        others = f"; there is {', '.join(interfaces)}, which was not tested" if interfaces else ""
        return _no_socketcan(f"the kernel has it, but there is no virtual interface{others}", make_vcan())
    up = [name for name in virtual if int(_read(network / name / "flags") or "0", 16) & IFF_UP]
    if not up:
        return _no_socketcan(f"{virtual[0]} is down", _as_root(f"ip link set up {virtual[0]}"))
    try:
        exchange(up[0])
    except OSError as error:
        return Finding(SOCKETCAN, State.BAD, f"no frame goes through {up[0]}: {_reason(error)}", SERVES[SOCKETCAN], make_vcan())
    return Finding(SOCKETCAN, State.GOOD, f"a frame went through {up[0]}", SERVES[SOCKETCAN])


def exchange(interface: str) -> None:
    """Send a frame from one socket and receive it at another. Raises OSError."""
    frame = struct.pack("=IB3x8s", FRAME_ID | EXTENDED, 8, os.urandom(8))  # struct can_frame of linux/can.h
    kind = (socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    with socket.socket(*kind) as sender, socket.socket(*kind) as receiver:
        receiver.settimeout(WAIT)
        only_this = struct.pack("=II", FRAME_ID | EXTENDED, FRAME_ID | EXTENDED)
        receiver.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, only_this)
        for each in (receiver, sender):
            each.bind((interface,))
        sender.send(frame)
        while receiver.recv(len(frame)) != frame:  # skip frames of another `codegen doctor`
            pass


def multicast() -> Finding:
    """Check that a frame passes from one node to another through python-can's udp_multicast."""
    remedy = "let the firewall pass UDP multicast, and give the machine a route for it: " + _as_root(
        "ip route add 224.0.0.0/4 dev lo"
    )
    try:
        from hil_sim.bus import Bus, BusAddress
        from hil_sim.codec import Frame

        sent = Frame(FRAME_ID, os.urandom(8), extended=True)
        address = BusAddress.parse(f"udp_multicast:{GROUP}")
        with Bus(address) as receiver, Bus(address) as sender:
            is_sent = sender.send(sent)
            received = receiver.receive(WAIT)
            while received is not None and received.data != sent.data:
                received = receiver.receive(WAIT)
    except CodegenError as error:
        return Finding(MULTICAST, State.BAD, error.what, SERVES[MULTICAST], error.remedy)
    except Exception as error:  # python-can or msgpack is broken
        return Finding(MULTICAST, State.BAD, one_line(repr(error), 150), SERVES[MULTICAST])
    if not is_sent or received is None:
        what = "a frame could not be sent" if not is_sent else f"a frame that was sent did not come within {WAIT:g} s"
        return Finding(MULTICAST, State.BAD, what, SERVES[MULTICAST], remedy)
    return Finding(MULTICAST, State.GOOD, f"a frame went through {GROUP}", SERVES[MULTICAST])


def make_vcan() -> str:
    """Return the commands that create a virtual CAN interface."""
    return " && ".join(map(_as_root, ("modprobe vcan", "ip link add dev vcan0 type vcan", "ip link set up vcan0")))


def _refused(error: OSError) -> Finding:
    if error.errno in (errno.EPERM, errno.EACCES):
        return _no_socketcan("this process may not open CAN sockets", "run it outside of the container or sandbox")
    if error.errno not in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        return _no_socketcan(_reason(error), OTHERWISE)
    listed = _modules_of_kernel()
    if not listed:
        return _no_socketcan("this kernel has no CAN, or has not loaded it", f"{make_vcan()}; where that fails, {OTHERWISE}")
    if "net/can/can.ko" in listed:
        return _no_socketcan("the kernel's module is not loaded", make_vcan())
    return _no_socketcan("this kernel was built without CAN", OTHERWISE)


def _modules_of_kernel() -> str:
    """Return the names of the running kernel's modules; empty in a container that does not see those of the host."""
    release = MODULES / platform.release()
    return "".join(_read(release / name) for name in ("modules.dep", "modules.builtin"))


def _no_socketcan(what: str, remedy: str) -> Finding:
    return Finding(SOCKETCAN, State.MISSING, what, SERVES[SOCKETCAN], remedy)


def _as_root(command: str) -> str:
    return command if os.geteuid() == 0 else f"sudo {command}"


def _reason(error: OSError) -> str:
    return "nothing came" if isinstance(error, TimeoutError) else one_line(error.strerror or error, 100)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace").strip()
    except OSError:
        return ""
