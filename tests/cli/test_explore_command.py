"""Start and end of `codegen explore`; tests/explore covers the page itself."""

import json
import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

from .conftest import MAIN, MAP, ROOT, everything_in, program

BROWSER = """
import json, os, pathlib, sys, urllib.parse, urllib.request

path = pathlib.Path(urllib.request.url2pathname(urllib.parse.urlsplit(sys.argv[1]).path))
modes = [oct(os.stat(each).st_mode & 0o777) for each in (path, path.parent)]
data = {"arguments": sys.argv[1:], "path": str(path), "text": path.read_text(encoding="utf-8"), "modes": modes}
pathlib.Path(__file__).with_suffix(".json").write_text(json.dumps(data), encoding="utf-8")
"""


def test_it_serves_until_a_signal_and_keeps_its_key_from_other_users(here: Path) -> None:
    """All users of a computer can read process arguments, so the browser's arguments must not contain the key."""
    script = here / "browser.py"
    script.write_text(BROWSER, encoding="utf-8")
    own = {"PYTHONPATH": str(ROOT), "BROWSER": f"{sys.executable} {script} %s", "DISPLAY": ":0", "TMPDIR": str(here)}
    command, environment = program(MAIN, "explore", "--map", MAP), {**os.environ, **own}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:")
        assert process.stdout.readline() == "Ctrl-C ends it.\n"
        with urllib.request.urlopen(address, timeout=60) as answer:
            assert b"<title>Explore 4ws2-paper</title>" in answer.read()
        process.send_signal(signal.SIGINT)  # it ends only after the browser has been started
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "", "")
    assert set(everything_in(here)) == {"browser.py", "browser.json"}
    data = json.loads(script.with_suffix(".json").read_text(encoding="utf-8"))
    key = address.partition("key=")[2]
    assert len(key) >= 32
    assert key not in " ".join(data["arguments"])
    assert f"url={address}" in data["text"]
    assert data["modes"] == ["0o600", "0o700"]
    assert not Path(data["path"]).exists()
