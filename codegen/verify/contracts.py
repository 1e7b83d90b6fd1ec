"""Prove the contracts of a build with CBMC: run every harness in its folder `verify/` and read the results."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from codegen.emit.contracts.proof import FOLDER, Proof
from codegen.emit.render import render
from codegen.errors import BuildError
from codegen.sil.software import Software
from codegen.verify.cbmc import Cbmc, installed
from codegen.verify.on_host import software_of
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.states import fields, initialised_states
from codegen.verify.tools import stored

Judged = Literal["proved", "failed", "open"]
TIME_LIMIT_S, QUICK_TIME_LIMIT_S = 300.0, 20.0
"""Time limit of each run of CBMC; the longest takes some 100 s on an idle machine with two cores."""
END = "check_end.assertion.1"
"""The assertion at the end of each harness, which must fail: properties that are never reached would count as proved."""


@dataclass(frozen=True)
class Result:
    """Result for one harness, with its run time, the number of properties that were checked, and what failed or is open."""

    harness: str
    verdict: Judged
    seconds: float = 0.0
    properties: int = 0
    detail: str = ""


def prove(build: Path, proofs: Iterable[Proof], cbmc: Cbmc, limit_s: float = TIME_LIMIT_S) -> list[Result]:
    """Run the proofs in parallel, on all processors.

    Args:
        build: folder of the build.
        proofs: those of its manifest, or some of them.
        limit_s: time limit of each proof.
    """
    # The longest commands have the most callees and take the longest time: they come first, so that none is left for the end.
    order = sorted(proofs, key=lambda proof: -len(proof.command()))
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as workers:
        results = workers.map(_Run(build, cbmc, limit_s).prove, order)
        return sorted(results, key=lambda result: result.harness)


def proofs_of(subject: Subject) -> list[Proof]:
    """Return the proofs of a build. Raises BuildError: an older version made it, whose manifest has none."""
    found = [Proof.model_validate(each) for each in subject.manifest.get("proofs", ())]
    if not found:
        raise BuildError("its manifest has no proofs", where=subject.name, remedy="build again with `codegen build`")
    return found


@dataclass(frozen=True)
class _Run:
    build: Path
    cbmc: Cbmc
    limit_s: float

    def prove(self, proof: Proof) -> Result:
        """Prove one harness, then check that its end is reached. An open one is not run."""
        if proof.open:
            return Result(proof.name, "open", detail=proof.open)
        start = time.monotonic()
        messages = self._messages(f"{proof.command()} --json-ui")
        properties = _results(messages)
        verdict, detail = _verdict(messages, properties)
        if verdict == "proved":
            messages = self._messages(f"{proof.command('-DCHECK_END')} --property {END} --json-ui")
            if not any((each["property"], each["status"]) == (END, "FAILURE") for each in _results(messages)):
                verdict, detail = "open", "the end of the harness is not known to be reached"
        return Result(proof.name, verdict, time.monotonic() - start, len(properties), detail)

    def _messages(self, command: str) -> list[dict[str, Any]]:
        """Return the messages of CBMC; none if the time limit ended it. Its solver ends with it."""
        streams: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        with (
            tempfile.TemporaryDirectory() as folder,
            # A session of its own, so that the solver, a child process, ends with it.
            subprocess.Popen(
                ["sh", "-c", command],
                cwd=self.build,
                env={**self.cbmc.environment, "TMPDIR": folder},
                start_new_session=True,
                **streams,
            ) as process,
        ):
            try:
                output, _ = process.communicate(timeout=self.limit_s)
            except subprocess.TimeoutExpired:
                return []
            finally:
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)
        try:
            messages: list[dict[str, Any]] = json.loads(output[output.find(b"[") :])
        except ValueError:
            return [{"messageType": "ERROR", "messageText": f"CBMC ended early, with exit code {process.returncode}"}]
        return messages


def _results(messages: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    return [result for message in messages for result in message.get("result", [])]


def _verdict(messages: list[dict[str, Any]], properties: list[dict[str, Any]]) -> tuple[Judged, str]:
    """Accept only CBMC's own success: a run that ends in an error can list all properties as not failed."""
    if not messages:
        return "open", "time limit"
    failed = [each for each in properties if each["status"] == "FAILURE"]
    if failed:
        return "failed", "; ".join(f"{each['description']} ({_place(each)})" for each in failed)
    if properties and [each["cProverStatus"] for each in messages if "cProverStatus" in each] == ["success"]:
        return "proved", ""
    errors = [str(each.get("messageText", "")) for each in messages if each.get("messageType") == "ERROR"]
    return "open", (errors or ["CBMC ended without a result"])[-1]


def _place(result: dict[str, Any]) -> str:
    place = result.get("sourceLocation", {})
    return f"{place.get('file', '?')}:{place.get('line', '?')}, {place.get('function', '?')}"


SHOWS = (
    "For every input, every valid parameter set, any valid map and every state within its invariant, each function keeps its "
    "contract: bounds, rates, transitions and invariants; nothing is undefined. An initialisation sets each member of its state"
)
LIMITS = (
    "CBMC uses the semantics of the C standard with rounding to nearest, and the type sizes of a 64-bit host. The compiled "
    "code is the subject of the processor in the loop.",
    "It assumes that pointers are valid and do not overlap, that one call at a time uses a state, and that calibration does "
    "not change during a call.",
    "An index inside a struct is checked against the whole object only. The abstract interpretation checks arrays that are "
    "indexed by name; lemma_gains covers the schedule of gains, which is read through pointers.",
    "A function that calls others is proved with their contracts in place of their code. Each of these is proved too.",
)


def initialisation_harnesses(software: Software, sources: Iterable[str]) -> Iterator[tuple[Proof, bytes]]:
    """Yield proof and harness of each initialisation: two memories of any content become the same, member by member.

    Args:
        sources: paths of the C files of the build; calls of other units are not replaced by their contracts.
    """
    for state in initialised_states(software):
        proof = Proof(name=f"{software.prefix}_{state}_init_members", files=tuple(sources))
        members = [*fields(software.ffi, software.new(state)[0])]
        given = {"prefix": software.prefix, "state": state, "proof": proof, "members": members}
        yield proof, render("verify/initialisation.c.j2", given)


def check(subject: Subject, effort: Effort) -> Outcome:
    """Prove the contracts of a build.

    Raises:
        MissingTool: CBMC or its solver is not installed.
        BuildError: see `proofs_of`.
    """
    if not subject.is_single:
        return Outcome(SHOWS, "", Verdict.NOT_RUN, ("the contracts are of single precision",), limits=LIMITS)
    cbmc = installed()
    files = subject.sources("include", "src", FOLDER)
    sources = [path for path in files if path.startswith("src/") and path.endswith(".c")]
    more = dict(initialisation_harnesses(software_of(subject), sources))
    with stored({**files, **{proof.path: harness for proof, harness in more.items()}}) as folder:
        results = prove(folder, [*proofs_of(subject), *more], cbmc, QUICK_TIME_LIMIT_S if effort.quick else TIME_LIMIT_S)
    failed, open_ = ([each for each in results if each.verdict == verdict] for verdict in ("failed", "open"))
    proved = len(results) - len(failed) - len(open_)
    return Outcome(
        shows=SHOWS,
        figure=f"{proved} of {len(results)} contracts and lemmas proved{f', {len(open_)} open' if open_ else ''}",
        verdict=Verdict.FAILED if failed or not proved else Verdict.PASSED,
        findings=tuple(f"{each.harness}: {each.detail}" for each in failed),
        figures={
            "harnesses": {each.harness: each.verdict for each in results},
            "properties": sum(each.properties for each in results if each.verdict == "proved"),
        },
        limits=(*LIMITS, *(f"{each.harness} is open: {each.detail}." for each in open_)),
        tools={"CBMC": cbmc.version},
    )
