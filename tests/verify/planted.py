"""Faults for builds, planted without knowing the text of the C."""

from __future__ import annotations

from codegen.emit.folder import Folder
from codegen.verify.check import Subject


def subject_of(folder: Folder, **changed: str) -> Subject:
    """A build under check; texts by path below src/, without ".c"."""
    files = {**folder.files, **{f"src/{name}.c": text.encode() for name, text in changed.items()}}
    return Subject("planted", files, folder.manifest)


def source(folder: Folder, name: str) -> str:
    """The text of src/NAME.c."""
    return folder.files[f"src/{name}.c"].decode()


def wrapped(folder: Folder, name: str, function: str, signature: str, body: str) -> Subject:
    """The build with a public function of src/NAME.c replaced; the old one is called planted_FUNCTION, also by its unit."""
    before, after = (
        f"#define {function} planted_{function}\n",
        f"#undef {function}\n{signature};\n{signature}\n{{\n{body}\n}}\n",
    )
    return subject_of(folder, **{name: before + source(folder, name) + after})


def limiter(folder: Folder, body: str) -> Subject:
    """The build whose safety limiter is wrapped; `body` may use and must return `result`."""
    return wrapped(
        folder,
        "ars_limiter",
        "ars_limiter_step",
        "float ars_limiter_step("
        "ars_limiter_t *self, const ars_limiter_parameters_t *parameters, const ars_limiter_input_t *input)",
        f"    float result = planted_ars_limiter_step(self, parameters, input);\n{body}\n    return result;",
    )
