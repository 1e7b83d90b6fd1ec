"""Check that the sources reject a header of another build, and a compiler that may ignore NaN."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from codegen.verify.outcomes import Subject
from codegen.verify.target import TARGET_FLAGS, source_tree, zig_result

REFUSES = "different builds"
"""Phrase of the error of a source or header that meets one of another build."""

FAST_FLAGS = ("-ffast-math", "-ffinite-math-only")
REFUSES_FAST = "fast-math"
FUNCTION = re.compile(r"\)\s*\{")

WITHOUT_IDENTITY = ("include/{prefix}_sections.h", "linux/ars_xcp.h")
"""Headers that are the same in every build."""

EMPTY = "empty"
"""Folder of the empty system headers."""
_PREPROCESS = ("-E", "-nostdinc", "-Iinclude", "-isystem", EMPTY, "-fno-caret-diagnostics")

_INCLUDE = re.compile(r'^#include "([^"\n]+)"', re.MULTILINE)
_SYSTEM = re.compile(r"^#include <([^>\n]+)>", re.MULTILINE)
_IDENTITY = re.compile(r"^#define +(\w+_BUILD) +0x([0-9A-F]+)u$", re.MULTILINE)
_INCLUDED = re.compile(r"In file included from ([^:]+):")
_ERROR = re.compile(r"([^:]+):\d+:\d+: error:")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


@dataclass(frozen=True)
class Mixture:
    """Source and a header that it includes, directly or indirectly."""

    source: str
    header: str


def text_of(subject: Subject, path: str) -> str:
    """Return the text of a C file."""
    return subject.files[path].decode("ascii", "replace")


def mixtures(subject: Subject) -> tuple[Mixture, ...]:
    """Return every source for an ECU or for the Linux program with each header of the build that it includes."""
    exempt = [path.format(prefix=subject.prefix) for path in WITHOUT_IDENTITY]
    sources = sorted(path for path in subject.sources("src", "linux") if path.endswith(".c"))
    return tuple(
        Mixture(source, header) for source in sources for header in sorted(_headers_of(subject, source)) if header not in exempt
    )


def _headers_of(subject: Subject, path: str) -> set[str]:
    """Return the build's own headers that a file includes."""
    seen: set[str] = set()
    waiting = [path]
    while waiting:
        for name in _INCLUDE.findall(text_of(subject, waiting.pop())):
            for header in (f"include/{name}", f"linux/{name}"):
                if header in subject.files and header not in seen:
                    seen.add(header)
                    waiting.append(header)
    return seen


def not_refused(subject: Subject) -> Iterator[str]:
    """Yield headers without an identity, and mixtures that the compiler accepts. Raises CodegenError if there is no
    compiler."""
    pairs = mixtures(subject)
    for header in sorted({pair.header for pair in pairs}):
        text = text_of(subject, header)
        identity = _IDENTITY.search(text)
        if identity is None:
            yield f"{header}:1: it does not say of which build it is"
            continue
        start, end = identity.span(2)
        other = f"{text[:start]}{int(identity[2], 16) ^ 1:08X}{text[end:]}"
        with source_tree({**_preprocessed(subject), header: other}) as tree:
            for source in _accepting([pair.source for pair in pairs if pair.header == header], (), REFUSES, tree):
                yield f"{source}:1: it takes a {PurePosixPath(header).name} of another build"


def takes_fast_math(subject: Subject) -> Iterator[str]:
    """Yield sources that compute with reals and accept -ffast-math. Raises CodegenError if there is no compiler."""
    with source_tree(_preprocessed(subject)) as tree:
        for flag in FAST_FLAGS:
            for source in _accepting(units_with_reals(subject), (flag,), REFUSES_FAST, tree):
                yield f"{source}:1: it takes {flag}"


def units_with_reals(subject: Subject) -> tuple[str, ...]:
    """Return sources for an ECU that compute with reals; a source without a function only stores them."""
    real = re.compile(rf"\b{'float' if subject.is_single else 'double'}\b")
    texts = {path: _COMMENT.sub(" ", text_of(subject, path)) for path in subject.sources("src") if path.endswith(".c")}
    return tuple(sorted(path for path, text in texts.items() if real.search(text) and FUNCTION.search(text)))


def _preprocessed(subject: Subject) -> dict[str, str | bytes]:
    """Return the sources with empty system headers: only macros of the build and of the compiler decide here."""
    sources = subject.sources("include", "src", "linux")
    system = {name for path in sources for name in _SYSTEM.findall(text_of(subject, path))}
    return {**sources, **{f"{EMPTY}/{name}": "" for name in system}}


def _accepting(sources: Sequence[str], flags: tuple[str, ...], phrase: str, tree: Path) -> list[str]:
    """Return the sources whose preprocessing meets no #error that contains the phrase."""
    output = zig_result(["cc", *TARGET_FLAGS, *flags, *_PREPROCESS, *sources], tree).stderr
    refusing = set()
    source = ""  # that includes the header of the next message, directly or indirectly
    for line in output.splitlines():
        if included := _INCLUDED.match(line):
            source = source or included[1]
            continue
        if phrase in line and (error := _ERROR.match(line)):
            refusing.add(source or error[1])
        source = ""
    return [each for each in sources if each not in refusing]
