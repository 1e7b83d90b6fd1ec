"""ECU and car as participants of SIL Kit, compared with the SIL: `python -m tests.export.demo_silkit PYTHON`.

PYTHON is an interpreter (3.12 or newer) with fmpy and silkit-py, whose wheel contains SIL Kit with its registry and system
controller. It is not a test of `make test`, because silkit-py does not support all Python versions of this project. The exit
code is 1 if frames differ.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

from tests.export.fmus import made
from tests.export.test_fmu_bus import driver, recorded

KIND, SCENARIO = "tracking", "sine-with-dwell"
ELAPSED = 0.005
"""Time in s from the frames of the car to the command: SIL Kit without a network simulator has no transmission times."""
SECONDS_MAX = 120.0
NODE = Path(__file__).with_name("silkit_node.py")
TOOLS = """from SilKit_py.tools import executable
print(executable("sil-kit-registry"))
print(executable("sil-kit-system-controller"))
"""


def free_address() -> str:
    """Return an address of this machine that no program listens on."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return f"silkit://127.0.0.1:{found.getsockname()[1]}"


def frames_of_silkit(python: str, inputs: list[dict[str, float]], cycles: int) -> list[tuple[int, bytes]]:
    """Return the frames of both nodes in the order of their times."""
    address, stop = free_address(), str(cycles * 10_000_000 - 1_000_000)
    registry, controller = subprocess.run([python, "-c", TOOLS], capture_output=True, text=True, check=True).stdout.split()
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with ExitStack() as stack:
        running = stack.enter_context(subprocess.Popen([registry, "-u", address], stdout=subprocess.PIPE, text=True))
        stack.callback(running.terminate)
        assert running.stdout is not None
        next(line for line in running.stdout if "listening" in line)
        other = stack.enter_context(subprocess.Popen([controller, "-u", address, "Ecu", "Car"], **quiet))
        stack.callback(other.terminate)
        nodes = []
        for what, name, given in (("ecu", "Ecu", []), ("bus_plant", "Car", inputs)):
            command = [python, str(NODE), str(made(what, "3", KIND).folder), name, address, stop]
            node = stack.enter_context(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))
            stack.callback(node.kill)
            assert node.stdin is not None
            node.stdin.write(json.dumps(given))
            node.stdin.close()
            node.stdin = None
            nodes.append(node)
        sent = [frame for node in nodes for frame in json.loads(node.communicate(timeout=SECONDS_MAX)[0])]
    return [(identifier, bytes.fromhex(data)) for _, identifier, data in sorted(sent, key=lambda frame: frame[0])]


def main() -> int:
    """Run the comparison and return the exit code."""
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    wanted, cycles = recorded(KIND, SCENARIO, ELAPSED)
    given = driver(KIND, SCENARIO)
    inputs = [dict(given(millisecond / 1000)) for millisecond in range(cycles * 10)]
    got = frames_of_silkit(sys.argv[1], inputs, cycles)
    is_equal = got == [(frame.id, frame.data) for frame in wanted]
    print(f"car and ECU in SIL Kit: {len(got)} frames: {'equal' if is_equal else 'NOT EQUAL'}")
    return 0 if is_equal else 1


if __name__ == "__main__":
    sys.exit(main())
