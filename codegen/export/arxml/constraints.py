"""Settings of the E2E protection that AUTOSAR does not allow for a transformer, and names that it does not allow.

Sources: System Template, constraints constr_3157, constr_3158, constr_3177 to constr_3181 and constr_3195; Generic Structure
Template, constr_2508.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree import ElementTree

from codegen.configuration.can import Can
from codegen.errors import BuildError

DATA_ID_MIN = 0x100
"""Smallest data id of variant 1C, whose frames carry its high byte."""

OF_COM = ("I-SIGNAL", "I-SIGNAL-GROUP", "I-SIGNAL-I-PDU", "I-SIGNAL-I-PDU-GROUP")
"""Kinds of elements that become containers of one configuration, that of COM."""

_SHORT_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,127}\Z", re.ASCII)


def check_names(model: ElementTree.Element) -> None:
    """Check that each short name is valid and, in any letter case, the only one in its element and, for COM, in the model.

    Only the name of a message and the prefix of the build can cause a fault.

    Raises:
        BuildError: a name is not.
    """
    used, waiting = set[str](), [(model, "")]
    while waiting:
        element, path = waiting.pop()
        name, kind = element.findtext("{*}SHORT-NAME"), element.tag.rpartition("}")[2]
        if name is not None:
            path = f"{path}/{name}"
            keys = {path.casefold()} | ({name.casefold()} if kind in OF_COM else set())
            valid = _SHORT_NAME.match(name)
            if used & keys or not valid:
                what = f"two elements are called {name} in any letter case" if valid else "it does not begin with a letter"
                remedy = "rename the message of that name in ars.toml, in [can], and build it again"
                raise BuildError(f"{what}, which AUTOSAR does not allow", where=path, remedy=remedy)
            used |= keys
        waiting += [(child, path) for child in reversed(element)]


def check_transformer(can: Can) -> None:
    """Check that AUTOSAR allows the settings for a transformer.

    Raises:
        BuildError: it does not.
    """
    fault = next(_faults(can), None)
    if fault is not None:
        where, what = fault
        raise BuildError(
            f"{what}, which AUTOSAR does not allow for a transformer",
            where=where,
            remedy="change it in ars.toml and build again with `config=`, or give `e2e='task'`",
        )


def _faults(can: Can) -> Iterator[tuple[str, str]]:
    """Yield table and description of each fault. The configuration checks the rest of the constraints."""
    e2e, where = can.e2e, "[can.e2e]"
    for smaller, larger in (("max_error_state_invalid", "max_error_state_init"), ("min_ok_state_init", "min_ok_state_invalid")):
        low, high = getattr(e2e, smaller), getattr(e2e, larger)
        if low > high:
            yield where, f"{smaller} = {low} is above {larger} = {high}"
    for state in ("init", "valid", "invalid"):
        total = getattr(e2e, f"min_ok_state_{state}") + getattr(e2e, f"max_error_state_{state}")
        if total > e2e.window_size:
            yield where, f"min_ok_state_{state} + max_error_state_{state} = {total} is above window_size = {e2e.window_size}"
    if e2e.definition.has_synchronisation and e2e.max_delta_counter_init < 1:
        yield where, f"max_delta_counter_init = {e2e.max_delta_counter_init} is below 1"
    for role, message in can.messages().items():
        number = message.e2e_data_id
        if e2e.profile == "1C" and isinstance(number, int) and number < DATA_ID_MIN:
            yield f"[can.{role}]", f"the data id 0x{number:X} is below 0x{DATA_ID_MIN:X}"
