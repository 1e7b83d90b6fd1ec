"""Network interfaces through kernel calls: no `ip`, no `modprobe`, only the standard library. Linux only."""

from __future__ import annotations

import fcntl
import os
import socket
import struct

INTERFACE = "vcan0"

# From the kernel's headers: linux/sockios.h, net/if.h, linux/netlink.h, linux/rtnetlink.h, linux/if_link.h.
SIOCGIFFLAGS = 0x8913
SIOCSIFFLAGS = 0x8914
IFF_UP = 0x1
IFF_MULTICAST = 0x1000
NLM_F_REQUEST, NLM_F_ACK, NLM_F_EXCL, NLM_F_CREATE = 0x1, 0x4, 0x200, 0x400
RTM_NEWLINK, RTM_DELLINK, IFLA_IFNAME, IFLA_LINKINFO, IFLA_INFO_KIND = 16, 17, 3, 18, 1
RTM_NEWROUTE, RTA_DST, RTA_OIF, RT_TABLE_MAIN, RTPROT_BOOT, RT_SCOPE_LINK, RTN_UNICAST = 24, 1, 4, 254, 3, 253, 1

_IFREQ = struct.Struct("=16sH22x")
_NETLINK_HEADER = struct.Struct("=IHHII")
_LINK = struct.Struct("=BxHiII")
_ROUTE = struct.Struct("=8BI")


def has_socketcan() -> bool:
    """Return whether this kernel has raw CAN sockets; the check loads its modules if permitted."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except (OSError, AttributeError):  # AttributeError: not Linux
        return False
    return True


def is_up(name: str) -> bool:
    """Return whether the interface exists and is up."""
    try:
        return bool(_flags(name) & IFF_UP)
    except OSError:
        return False


def set_interface(name: str, up: bool) -> None:
    """Set an interface up or down. Raises OSError: it does not exist, or this process is not root."""
    flags = _flags(name)
    _ioctl(SIOCSIFFLAGS, name, flags | IFF_UP if up else flags & ~IFF_UP)


def add_vcan(name: str) -> None:
    """Create a virtual CAN interface and set it up. Raises OSError: it exists, no permission, or a kernel without vcan."""
    link = _attribute(IFLA_IFNAME, name.encode() + b"\0") + _attribute(IFLA_LINKINFO, _attribute(IFLA_INFO_KIND, b"vcan"))
    _netlink(RTM_NEWLINK, _LINK.pack(socket.AF_UNSPEC, 0, 0, IFF_UP, IFF_UP) + link)


def remove(name: str) -> None:
    """Remove an interface, as `ip link delete` does."""
    link = _LINK.pack(socket.AF_UNSPEC, 0, socket.if_nametoindex(name), 0, 0)
    _netlink(RTM_DELLINK, link, NLM_F_REQUEST | NLM_F_ACK)


def set_loopback_up() -> None:
    """Set `lo` up, with a route for multicast: `udp_multicast` then works even without another network."""
    _ioctl(SIOCSIFFLAGS, "lo", _flags("lo") | IFF_UP | IFF_MULTICAST)
    to = _attribute(RTA_DST, socket.inet_aton("224.0.0.0"))
    to += _attribute(RTA_OIF, struct.pack("=I", socket.if_nametoindex("lo")))
    route = _ROUTE.pack(socket.AF_INET, 4, 0, 0, RT_TABLE_MAIN, RTPROT_BOOT, RT_SCOPE_LINK, RTN_UNICAST, 0)
    _netlink(RTM_NEWROUTE, route + to)


def _flags(name: str) -> int:
    (flags,) = struct.unpack_from("=H", _ioctl(SIOCGIFFLAGS, name, 0), 16)
    return int(flags)


def _ioctl(request: int, name: str, flags: int) -> bytes:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        return fcntl.ioctl(control, request, _IFREQ.pack(name.encode(), flags))


def _attribute(kind: int, value: bytes) -> bytes:
    padding = b"\0" * (-len(value) % 4)
    return struct.pack("=HH", 4 + len(value), kind) + value + padding


def _netlink(kind: int, body: bytes, flags: int = NLM_F_REQUEST | NLM_F_ACK | NLM_F_CREATE | NLM_F_EXCL) -> None:
    """Send a request, by default to create something, and wait for the reply."""
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as kernel:
        kernel.send(_NETLINK_HEADER.pack(_NETLINK_HEADER.size + len(body), kind, flags, 1, 0) + body)
        (error,) = struct.unpack_from("=i", kernel.recv(4096), _NETLINK_HEADER.size)
    if error:
        raise OSError(-error, os.strerror(-error))
