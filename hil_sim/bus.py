"""Any bus that python-can supports, named INTERFACE:CHANNEL; one clear line if it cannot be opened."""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import logging
import socket
import sys
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import can

from codegen.configuration.can import Can
from codegen.errors import CodegenError, one_line
from codegen.requirements import pip_install
from hil_sim.codec import Frame

LOCAL_INTERFACES = ("virtual", "socketcan", "udp_multicast")
"""Interfaces without hardware, or whose bit rate is set elsewhere."""

NETWORK = Path("/sys/class/net")
"""Folder of the network interfaces on Linux."""
ARPHRD_CAN, CANFD_MTU = 280, 72
"""Kind of a CAN interface, and size of a frame of CAN FD (linux/if_arp.h, linux/can.h)."""

_PACKAGES = {"udp_multicast": "msgpack"}


@dataclass(frozen=True)
class BusAddress:
    """INTERFACE:CHANNEL as two parts: a python-can interface, and one of its channels."""

    interface: str
    channel: str

    @classmethod
    def parse(cls, text: str) -> BusAddress:
        """Parse the bus from the command line. Raises CodegenError."""
        interface, separator, channel = text.partition(":")
        if not separator or not interface or not channel:
            raise CodegenError(
                f"{text!r} is not INTERFACE:CHANNEL",
                where="`bus=`",
                remedy="give e.g. socketcan:vcan0 or udp_multicast:239.74.163.2",
            )
        if interface not in can.VALID_INTERFACES:
            known = ", ".join(sorted(can.VALID_INTERFACES))
            raise CodegenError(f"python-can has no interface {interface!r}", where="`bus=`", remedy=f"known: {known}")
        if interface == "socketcan" and channel.startswith("-"):  # would be an option of the native ECU
            raise CodegenError(f"{channel!r} cannot be a CAN interface", where="`bus=`", remedy="name one, such as vcan0")
        return cls(interface, channel)

    def __str__(self) -> str:
        return f"{self.interface}:{self.channel}"


class Bus:
    """Access of one node to a bus; a context manager.

    The node does not receive its own frames if the interface can distinguish them.

    Raises:
        CodegenError: it cannot be opened; the message has the remedy.
    """

    def __init__(self, address: BusAddress, can_of_build: Can | None = None) -> None:
        self.address = address
        package = _PACKAGES.get(address.interface)
        if package and importlib.util.find_spec(package) is None:
            what = f"{address.interface} needs the package {package}"
            raise CodegenError(what, where="`bus=`", remedy=pip_install(package))
        settings: dict[str, Any] = {}
        if can_of_build is not None and address.interface not in LOCAL_INTERFACES:
            settings["bitrate"] = round(can_of_build.bitrate_kbit_s * 1e3)
            if can_of_build.data_bitrate_kbit_s is not None:
                settings["data_bitrate"] = round(can_of_build.data_bitrate_kbit_s * 1e3)
        if can_of_build is not None and can_of_build.is_fd:
            settings["fd"] = True
            if address.interface == "socketcan":
                require_fd(address.channel)
        # Messages of the backends become part of the error.
        logging.getLogger("can").setLevel(logging.CRITICAL + 1)
        try:
            self._bus = can.Bus(interface=address.interface, channel=address.channel, receive_own_messages=False, **settings)
        except Exception as error:  # a backend without its driver may raise anything
            raise _cannot_open(address, error) from error
        if address.interface == "udp_multicast":
            _keep_to_the_group(self._bus)

    def send(self, frame: Frame) -> bool:
        """Send a frame. Return False if the bus is down or its queue is full."""
        message = can.Message(
            arbitration_id=frame.id,
            data=frame.data,
            is_extended_id=frame.extended,
            is_remote_frame=frame.remote,
            is_error_frame=frame.error,
            is_fd=frame.fd,
            bitrate_switch=frame.fd,
        )
        try:
            self._bus.send(message)
        except (can.CanError, OSError):
            return False
        return True

    def receive(self, timeout: float) -> Frame | None:
        """Return the next frame within `timeout` (s; 0: only a waiting one), or None.

        A bus that is down counts as silent.
        """
        try:
            message = self._bus.recv(max(timeout, 0.0))
        except (can.CanError, OSError):
            return None
        if message is None:
            return None
        return Frame(
            message.arbitration_id,
            bytes(message.data),
            extended=message.is_extended_id,
            remote=message.is_remote_frame,
            error=message.is_error_frame,
            fd=message.is_fd,
        )

    def close(self) -> None:
        """Leave the bus."""
        with contextlib.suppress(can.CanError, OSError):
            self._bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _keep_to_the_group(bus: Any) -> None:
    """Set the socket option of multicast buses. By default, Linux delivers frames of every group that any process has
    joined."""
    inner = getattr(getattr(bus, "_multicast", None), "_socket", None)
    if inner is not None and sys.platform == "linux":
        level, option = (socket.IPPROTO_IPV6, 29) if inner.family == socket.AF_INET6 else (socket.IPPROTO_IP, 49)
        inner.setsockopt(level, option, 0)  # IPV6_MULTICAST_ALL, IP_MULTICAST_ALL of linux/in6.h, linux/in.h


def require_fd(name: str) -> None:
    """Raise CodegenError if a network interface of this name carries frames of classical CAN only."""
    if (_property_of(name, "mtu") or CANFD_MTU) < CANFD_MTU:
        remedy = f"set its MTU to {CANFD_MTU}, or configure the hardware with dbitrate and fd on (ip link set)"
        raise CodegenError("the interface carries no frames of CAN FD", where=name, remedy=remedy)


def _is_another_kind(name: str) -> bool:
    """Return whether a network interface of this name exists and is not CAN."""
    return _property_of(name, "type") not in (None, ARPHRD_CAN)


def _property_of(name: str, file: str) -> int | None:
    """Return a number that the kernel knows of a network interface; None if there is no such interface."""
    try:
        return int((NETWORK / name / file).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def _cannot_open(address: BusAddress, error: BaseException) -> CodegenError:
    number = getattr(error, "errno", None)
    if address.interface == "socketcan" and _is_another_kind(address.channel):
        return CodegenError("not a CAN interface", where=str(address), remedy="name one that is, such as vcan0")
    if address.interface == "socketcan" and number == errno.ENODEV:
        name = address.channel
        return CodegenError(
            "there is no such CAN interface",
            where=str(address),
            remedy=f"make one: sudo ip link add dev {name} type vcan && sudo ip link set up {name}",
        )
    if address.interface == "socketcan" and (number in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT)):
        return CodegenError(
            "this system has no SocketCAN",
            where=str(address),
            remedy="load it (sudo modprobe vcan), or use `bus='udp_multicast:239.74.163.2'`",
        )
    text = one_line(str(error)) or type(error).__name__
    return CodegenError(
        f"the bus cannot be opened: {text}", where=str(address), remedy="check the channel, the driver and the interface"
    )
