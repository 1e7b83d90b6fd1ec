"""Faults planted in a function by its name, independent of the text of the C."""

import re

from codegen.emit.folder import Folder
from codegen.verify.outcomes import Subject


def subject_of(folder: Folder, **changed: str) -> Subject:
    """Return the subject of a check; the texts replace src/NAME.c."""
    files = {**folder.files, **{f"src/{name}.c": text.encode() for name, text in changed.items()}}
    return Subject("planted", files, folder.manifest)


def source(folder: Folder, name: str) -> str:
    """Return the text of src/NAME.c."""
    return folder.files[f"src/{name}.c"].decode()


def _definition(folder: Folder, function: str) -> tuple[str, re.Match[str]]:
    """Return the unit that defines a function and the match of its head."""
    pattern = re.compile(rf"^(ARS_SECTION_CODE\s+)?(\w[^;{{}}()#]*\b{function}\([^;{{}}]*\))\n\{{\n", re.MULTILINE)
    units = [path[4:-2] for path in folder.files if path.startswith("src/") and path.endswith(".c")]
    ((name, found),) = ((name, match) for name in units for match in pattern.finditer(source(folder, name)))
    return name, found


def started(folder: Folder, function: str, statements: str, before: str = "") -> Subject:
    """Return the build with statements at the start of a function, and with text before its definition."""
    name, head = _definition(folder, function)
    text = source(folder, name)
    planted = text[: head.start()] + before + head[0] + statements + text[head.end() :]
    return subject_of(folder, **{name: planted})


def wrapped(folder: Folder, function: str, body: str) -> Subject:
    """Return the build with a function replaced; its unit and the new body call the original as planted_FUNCTION."""
    name, head = _definition(folder, function)
    renamed = f"#define {function} planted_{function}\n{source(folder, name)}#undef {function}\n"
    return subject_of(folder, **{name: f"{renamed}{head[2]};\n{head[2]}\n{{\n{body}\n}}\n"})


def limiter(folder: Folder, body: str) -> Subject:
    """Return the build whose safety limiter is wrapped; the body may change `result`, which is returned."""
    call = "    float result = planted_ars_limiter_step(self, parameters, input);"
    return wrapped(folder, "ars_limiter_step", f"{call}\n{body}\n    return result;")
