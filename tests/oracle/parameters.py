"""The default parameters of the C compared with the configuration."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from codegen.emit.parameters import Parameter
from codegen.sil.software import Software
from codegen.verify.unit_drives import Number, fields, value_of


def differences(software: Software) -> Iterator[str]:
    """Yield a line for each default parameter of the C that differs from the configuration."""
    parameters = software.parameters()
    if not software.function("parameters_valid")(parameters):
        yield "the C refuses its own default parameters"
    for holder, parameter, name in fields(software.config, parameters):
        have, want = value_of(holder, parameter.name), _configured(parameter, software)
        if have != want:
            yield f"{name} is {_text(have)}, not the configuration's {_text(want)}"


def _configured(parameter: Parameter, software: Software) -> Number:
    """Return the value of the configuration, rounded to the numbers of the build."""
    value = parameter.value
    return value if isinstance(value, int) else np.array(value, dtype=software.real).tolist()


def _text(value: Number) -> str:
    return "{" + ", ".join(f"{number:.9g}" for number in value) + "}" if isinstance(value, list) else f"{value:.9g}"
