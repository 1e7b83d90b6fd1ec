"""Checks of `codegen doctor` on a machine, in the order of the output.

Each check returns findings; none of them raises because something is missing or broken. The CAN buses are each tried with a
frame, which is sent only where no car can receive it: on a virtual CAN interface, and to a separate multicast group.
"""

from __future__ import annotations

import enum
import errno
import importlib
import os
import platform
import shutil
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from codegen import __version__
from codegen.cache import choose_folder
from codegen.errors import BuildError, CodegenError, one_line
from codegen.programs import run_program
from codegen.requirements import Requirement, extras_of, pip_install, requirements
from codegen.sil.toolchain import compiler_command, compiler_identity
from codegen.verify import cbmc
from codegen.verify.tools import MissingTool


class State(enum.StrEnum):
    """State of the checked item."""

    GOOD = "good"
    MISSING = "missing"
    """Not installed; some feature is not available."""
    BAD = "bad"
    """Installed, but broken or not suitable."""


@dataclass(frozen=True)
class Finding:
    """One line of the output.

    Attributes:
        name: name of the checked item.
        state: its state.
        what: its version, or the problem.
        serves: its purpose.
        remedy: what to type; "" if there is nothing to do.
        needed: whether `codegen sil` needs it.
    """

    name: str
    state: State
    what: str
    serves: str = ""
    remedy: str = ""
    needed: bool = False

    @property
    def stops(self) -> bool:
        """Whether `codegen sil` cannot work because of it."""
        return self.needed and self.state is not State.GOOD


FRAME_ID = 0x1FFF_FFFF
"""Extended identifier of the lowest priority; no message of a build uses it."""
EXTENDED = 0x8000_0000  # CAN_EFF_FLAG of linux/can.h
WAIT = 2.0
"""Timeout in s for a frame within this machine."""

SOCKETCAN, MULTICAST = "SocketCAN", "udp_multicast"
SERVES_OF_BUS = {
    SOCKETCAN: "--bus socketcan:vcan0 and --ecu native",
    MULTICAST: "--bus udp_multicast:239.74.163.2, which needs no CAN in the kernel",
}
GROUP = "239.74.163.97"
"""Multicast group in the range for local use (RFC 2365); differs from that of the examples."""

OTHERWISE = "use --bus udp_multicast:239.74.163.2, or make evidence PART=vcan for a guest with CAN"

NETWORK = Path("/sys/class/net")
KERNEL_MODULES = Path("/lib/modules")
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
        return Finding(
            SOCKETCAN, State.BAD, f"no frame goes through {up[0]}: {_reason(error)}", SERVES_OF_BUS[SOCKETCAN], make_vcan()
        )
    return Finding(SOCKETCAN, State.GOOD, f"a frame went through {up[0]}", SERVES_OF_BUS[SOCKETCAN])


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
        return Finding(MULTICAST, State.BAD, error.what, SERVES_OF_BUS[MULTICAST], error.remedy)
    except Exception as error:  # python-can or msgpack is broken
        return Finding(MULTICAST, State.BAD, one_line(repr(error), 150), SERVES_OF_BUS[MULTICAST])
    if not is_sent or received is None:
        what = "a frame could not be sent" if not is_sent else f"a frame that was sent did not come within {WAIT:g} s"
        return Finding(MULTICAST, State.BAD, what, SERVES_OF_BUS[MULTICAST], remedy)
    return Finding(MULTICAST, State.GOOD, f"a frame went through {GROUP}", SERVES_OF_BUS[MULTICAST])


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
    release = KERNEL_MODULES / platform.release()
    return "".join(_read(release / name) for name in ("modules.dep", "modules.builtin"))


def _no_socketcan(what: str, remedy: str) -> Finding:
    return Finding(SOCKETCAN, State.MISSING, what, SERVES_OF_BUS[SOCKETCAN], remedy)


def _as_root(command: str) -> str:
    return command if os.geteuid() == 0 else f"sudo {command}"


def _reason(error: OSError) -> str:
    return "nothing came" if isinstance(error, TimeoutError) else one_line(error.strerror or error, 100)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace").strip()
    except OSError:
        return ""


PERIOD = 0.001
"""Step of the plant, in s."""
WAITS = 50
LATENESS_MAX_FRACTION = 0.5
"""Fraction of the period by which a wait may end late; beyond it the bench counts late cycles in real time."""
PRIORITY = 1


def punctuality() -> Finding:
    """Measure the median and worst delay of waits of a millisecond in an idle process."""
    name, serves = "timer", "hil and plant by the clock"
    late = []
    for _ in range(WAITS):
        start = time.monotonic()
        time.sleep(PERIOD)
        late.append(time.monotonic() - start - PERIOD)
    middle, worst = statistics.median(late), max(late)
    what = f"waits of 1 ms end {1e3 * middle:.2f} ms late, at worst {1e3 * worst:.1f} ms"
    if middle > LATENESS_MAX_FRACTION * PERIOD:
        return Finding(name, State.BAD, what, serves, "use --lock-step, or a machine with less load")
    return Finding(name, State.GOOD, what, serves)


def real_time() -> Finding:
    """Check whether this user may use real-time scheduling, by trying it and undoing it."""
    name, serves = "SCHED_FIFO", "the native ECU's --priority, for exact timing under other load"
    if not hasattr(os, "SCHED_FIFO"):
        return Finding(name, State.MISSING, "this system has none", serves)
    before, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        remedy = "add `USER - rtprio 50` to /etc/security/limits.conf and log in again"
        return Finding(name, State.MISSING, "not permitted", serves, remedy)
    os.sched_setscheduler(0, before, parameter)
    return Finding(name, State.GOOD, "permitted", serves)


HEADER = "int sum(int one, int other);\n"
SOURCE = '#include "tiny.h"\n\nint sum(int one, int other)\n{\n    return one + other;\n}\n'

_TRIAL = """
import sys
from codegen.errors import BuildError
from codegen.sil.compile import compile_library
try:
    made = compile_library("doctor", {"include/tiny.h": sys.argv[1], "src/tiny.c": sys.argv[2]}, ["include/tiny.h"])
except BuildError as error:
    sys.exit(str(error))
if made.lib.sum(19, 23) != 42:
    sys.exit("it computes 19 + 23 wrong")
print(made.mode)
"""

HOW = {
    "api": "compiled against Python's headers",
    "abi": "compiled as a plain library, because Python's headers are not installed",
}


def cache() -> Finding:
    """Check the folder of compiled files and whether it is writable."""
    serves = "compiled C, so that later runs start at once"
    try:
        chosen = choose_folder()
    except BuildError as error:
        return Finding("cache", State.BAD, error.what, serves, error.remedy, needed=True)
    if chosen.reason:
        what = f"{chosen.path}, because {chosen.reason}"
        return Finding("cache", State.GOOD, what, serves, "set ARS_CACHE to a folder of your own", needed=True)
    return Finding("cache", State.GOOD, str(chosen.path), serves, needed=True)


def module() -> Finding:
    """Compile a small module and call it, in a separate process and folder, without the cache."""
    name, serves = "C in Python", "codegen sil, and all that runs the generated C"
    try:
        with tempfile.TemporaryDirectory(prefix="ars-doctor-") as folder:
            root = str(Path(__file__).resolve().parents[2])
            path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH", ""))))
            environment = {**os.environ, "ARS_CACHE": folder, "PYTHONPATH": path}
            answer = run_program([sys.executable, "-c", _TRIAL, HEADER, SOURCE], environment=environment)
    except OSError as error:
        return Finding(name, State.BAD, f"it could not be tried: {one_line(error)}", serves, "free space", needed=True)
    if answer.returncode == 0:
        return Finding(name, State.GOOD, HOW[answer.stdout.strip()], serves, needed=True)
    what = (answer.stderr.strip().splitlines() or [f"it ended with exit code {answer.returncode}"])[-1]
    return Finding(name, State.BAD, one_line(what), serves, "check the compiler with a small program of your own", needed=True)


PYTHON = (3, 11)

SERVES = {
    "casadi": "the optimisation, the vehicle models, and their C",
    "cffi": "the generated C in Python",
    "click": "the command line",
    "jinja2": "the templates",
    "matplotlib": "pictures (--plot)",
    "msgpack": "the bus udp_multicast",
    "numpy": "arrays",
    "packaging": "versions of packages",
    "pycparser": "C declarations",
    "pydantic": "ars.toml",
    "python-can": "buses and their logs",
    "rich": "progress and the live view",
    "scipy": "frequency responses",
    "tomlkit": "editing ars.toml with its comments",
}
"""Purposes of the required packages."""

MODULES = {"python-can": "can"}
"""Names of modules that differ from the name of their package."""

EXTRAS = {
    "tools": "files of other tools: A2L of a linked program (codegen a2l), images (codegen calibrate), MF4 and Parquet (-o, "
    "--log), drives and databases of buses (codegen identify), XCP (hil --xcp), the check of FMUs",
    "notebook": "notebooks of the library: Jupyter, runs as tables of pandas and datasets of xarray",
    "crosscheck": "a second plant, a third party's multi-body car, in codegen suite",
    "verify": "codegen verify: compilers for ECU cores, emulated processors, MISRA checks; --run of codegen firmware "
    "without a cross compiler",
    "report": "codegen report and codegen explore: plots that can be turned, cut and read",
    "sweep": "codegen sweep: campaigns in Parquet, and clusters by Dask",
    "docs": "the guide, built from docs/",
    "dev": "development of codegen: tests, types, lint, packaging",
}
"""Purpose of each extra."""


def python() -> Finding:
    """Check the version of the interpreter."""
    fits = sys.version_info >= PYTHON
    wanted = ".".join(map(str, PYTHON))
    what = f"{platform.python_version()} ({sys.executable})" + ("" if fits else f"; {wanted} or newer is required")
    remedy = "" if fits else f"install Python {wanted} or newer, and codegen in it"
    return Finding("Python", State.GOOD if fits else State.BAD, what, "", remedy, needed=True)


def needed(asked: Requirement) -> Finding:
    """Check a package that codegen always needs. It is imported, because an installed package may be broken."""
    serves = SERVES.get(asked.name, "")
    remedy = pip_install(asked.name)
    found = _version(asked.name)
    if found is None:
        return Finding(asked.name, State.MISSING, f"not installed; {asked.bounds} is required", serves, remedy, needed=True)
    if not asked.allows(found):
        return Finding(asked.name, State.BAD, f"{found}; {asked.bounds} is required", serves, remedy, needed=True)
    try:
        importlib.import_module(MODULES.get(asked.name, asked.name))
    except Exception as error:  # an incompatible package may raise anything
        what = f"{found} cannot be imported: {one_line(error, 120) or type(error).__name__}"
        again = remedy.replace("install", "install --force-reinstall", 1)
        return Finding(asked.name, State.BAD, what, serves, again, needed=True)
    return Finding(asked.name, State.GOOD, found, serves, needed=True)


def extra(name: str, asked: Iterable[Requirement]) -> Finding:
    """Return a finding for an extra: complete, or what is missing and what it would add."""
    asked = [each for each in asked if each.extra == name]
    missing = [each.name for each in asked if _version(each.name) is None]
    others = [(each, found) for each in asked if (found := _version(each.name)) is not None and not each.allows(found)]
    serves = EXTRAS.get(name, "")
    wrong = [f"{each.name} {found} ({each.bounds} is required)" for each, found in others]
    if not missing and not wrong:
        return Finding(name, State.GOOD, f"{len(asked)} package{'s' * (len(asked) != 1)}", serves)
    parts = ([f"without {', '.join(missing)}"] if missing else []) + wrong
    remedy = pip_install(*missing, *(each.name for each, _ in others))
    return Finding(name, State.MISSING if missing else State.BAD, "; ".join(parts), serves, remedy)


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


ANSWER_LIMIT = 20.0
"""Timeout of a query for a version, in s."""


@dataclass(frozen=True)
class OptionalProgram:
    """An external program that a feature uses.

    Attributes:
        names: names to search for, in order.
        package: its package on Debian and Ubuntu.
        arguments: arguments that print its version; empty if there are none.
    """

    names: tuple[str, ...]
    package: str
    serves: str
    arguments: tuple[str, ...] = ("--version",)


PROGRAMS = (
    OptionalProgram(("make",), "make", "generated Makefiles, codegen firmware --run"),
    OptionalProgram(("cmake",), "cmake", "generated folders as a CMake project"),
    OptionalProgram(("clang",), "clang", "a second compiler; MC/DC and libFuzzer in make evidence"),
    OptionalProgram(("arm-none-eabi-gcc",), "gcc-arm-none-eabi", "codegen firmware --run with GCC"),
    OptionalProgram(("qemu-system-arm",), "qemu-system-arm", "codegen firmware --run"),
    OptionalProgram(("frama-c",), "frama-c-base", "abstract interpretation in codegen verify", ("-version",)),
    OptionalProgram(("candump",), "can-utils", "inspecting a bus by hand", ()),
    OptionalProgram(("ip",), "iproute2", "creating vcan0", ("-Version",)),
    OptionalProgram(("chromium", "chromium-browser", "google-chrome"), "chromium", "the tests of reports, in a browser"),
)


def compiler() -> Finding:
    """Check the C compiler, which `codegen sil` needs."""
    serves = "the generated C on this machine"
    try:
        command = compiler_command()
        what = f"{compiler_identity(command, ())[0]} ({command[0]})"
    except BuildError as error:
        remedy = error.remedy or "install one, e.g. apt install gcc libc6-dev, or set CC"
        return Finding("C compiler", State.MISSING, error.what, serves, remedy, needed=True)
    return Finding("C compiler", State.GOOD, what, serves, needed=True)


def look_for(program: OptionalProgram) -> Finding:
    """Check an optional program; `codegen sil` needs none of them."""
    name = program.names[0]
    path = next(filter(None, map(shutil.which, program.names)), None)
    if path is None:
        return Finding(name, State.MISSING, "not installed", program.serves, f"apt install {program.package}")
    if not program.arguments:
        return Finding(name, State.GOOD, path, program.serves)
    try:
        answer = run_program([path, *program.arguments], timeout=ANSWER_LIMIT)
    except (OSError, subprocess.TimeoutExpired) as error:
        return Finding(name, State.BAD, f"{path} does not run: {one_line(error, 100)}", program.serves)
    told = (answer.stdout or answer.stderr).strip().splitlines()
    if answer.returncode != 0 or not told:
        return Finding(name, State.BAD, f"{path} does not report its version (exit code {answer.returncode})", program.serves)
    return Finding(name, State.GOOD, one_line(told[0], 80), program.serves)


def model_checker() -> Finding:
    """Check CBMC with Bitwuzla, which may be in the cache instead of the system."""
    serves = "proofs of the contracts in codegen verify"
    try:
        version = cbmc.installed().version
    except MissingTool as error:
        return Finding("cbmc", State.MISSING, f"{error.where} is not installed", serves, cbmc.INSTALL)
    return Finding("cbmc", State.GOOD if version else State.BAD, version or "it does not report its version", serves)


@dataclass(frozen=True)
class Section:
    """Findings of one kind."""

    key: str
    title: str
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class Examination:
    """Results of all checks.

    Attributes:
        read_from: source of the required package versions.
    """

    sections: tuple[Section, ...]
    read_from: str

    @property
    def stopping(self) -> tuple[Finding, ...]:
        """Findings that prevent `codegen sil` from working."""
        return tuple(finding for section in self.sections for finding in section.findings if finding.stops)

    def to_dict(self) -> dict[str, Any]:
        """Return the findings for JSON."""
        sections = {
            section.key: [{**asdict(finding), "state": str(finding.state)} for finding in section.findings]
            for section in self.sections
        }
        facts = {"codegen": __version__, "ready": not self.stopping, "requirements": self.read_from}
        return {**facts, **sections}


def examine() -> Examination:
    """Run all checks."""
    asked, read_from = requirements()
    sections = (
        Section("needed", "Needed by every command", (python(), *(needed(each) for each in asked if not each.extra))),
        Section("compiler", "C on this machine", (compiler(), cache(), module())),
        Section("extras", "Extras", tuple(extra(name, asked) for name in extras_of(asked))),
        Section("programs", "Programs", (*map(look_for, PROGRAMS), model_checker())),
        Section("buses", "Buses", (socketcan(), multicast())),
        Section("clock", "Real time", (punctuality(), real_time())),
    )
    return Examination(sections, read_from)
