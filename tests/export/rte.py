"""A small RTE, made from the ARXML alone: header of the component (contract phase), storage behind its ports, and COM.

As an RTE generator does, it reads types, ports, runnables and parameters by following the references; no table of the generator
is used. COM and the E2E transformer are cantools, reading the same ARXML, and the bench's implementation of the E2E protocol.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import autosar_data
import cantools

from codegen.configuration.can import E2e
from codegen.configuration.e2e_profiles import DataId, ProfileName
from hil_sim.e2e import E2eState, E2eStatus, Receiver, Supervision, next_counter, protect

Element = Message = Any

PRELUDE = """
#ifndef RTE_ARS_H
#define RTE_ARS_H
#include <stdint.h>

typedef uint8_t uint8;
typedef uint16_t uint16;
typedef uint32_t uint32;
typedef int8_t sint8;
typedef int16_t sint16;
typedef int32_t sint32;
typedef float float32;
typedef double float64;
typedef uint8 Std_ReturnType;
typedef uint8 Std_TransformerErrorCode;
typedef uint8 Std_TransformerClass;
typedef struct {
    Std_TransformerErrorCode errorCode;
    Std_TransformerClass transformerClass;
} Std_TransformerError;

#define RTE_E_OK 0u
#define RTE_E_INVALID 1u
#define RTE_E_LOST_DATA 64u
#define RTE_E_NO_DATA 131u
#define RTE_E_NEVER_RECEIVED 133u
#define RTE_E_SOFT_TRANSFORMER_ERROR 140u
#define STD_TRANSFORMER_SAFETY 2u
"""

QUEUE = """
Std_ReturnType Rte_Receive_{port}_{element}(uint8 *data)
{{
    uint32 k;
    if (rte_{port}_read == rte_{port}_written) {{
        return RTE_E_NO_DATA;
    }}
    for (k = 0u; k < sizeof(rte_{port}[0]); k++) {{
        data[k] = rte_{port}[rte_{port}_read % {length}u][k];
    }}
    rte_{port}_read++;
    return RTE_E_OK;
}}
"""

STATUS = """
static Std_ReturnType status_of(uint8 code, Std_ReturnType status, Std_TransformerError *error)
{
    if (code != 0u) {
        error->errorCode = code;
        error->transformerClass = STD_TRANSFORMER_SAFETY;
        return RTE_E_SOFT_TRANSFORMER_ERROR;
    }
    return status;
}
"""

LAST = """
Std_ReturnType Rte_Read_{port}_{element}({type} *data, Std_TransformerError *error)
{{
    *data = rte_{port};
    return status_of(rte_{port}_code, rte_{port}_status, error);
}}
"""

BUFFER = """
static struct {{ {type} data; uint8 code, status; }} rte_{port}_buffer;
const {type} *Rte_IRead_{runnable}_{port}_{element}(void)
{{
    return &rte_{port}_buffer.data;
}}
Std_ReturnType Rte_IStatus_{runnable}_{port}_{element}(Std_TransformerError *error)
{{
    return status_of(rte_{port}_buffer.code, rte_{port}_buffer.status, error);
}}
static void rte_{port}_fill(void)
{{
    rte_{port}_buffer.data = rte_{port};
    rte_{port}_buffer.code = rte_{port}_code;
    rte_{port}_buffer.status = rte_{port}_status;
}}
"""
"""Storage of implicit access, which is filled before the runnable starts."""


def load(folder: Path) -> tuple[Any, list[str]]:
    """Return the strictly loaded model of all ARXML in a folder, and the warnings."""
    model, warnings = autosar_data.AutosarModel(), list[str]()
    for path in sorted(folder.glob("*.arxml")):
        warnings += model.load_file(str(path), strict=True)[1]
    return model, warnings


def named(model: Any, kind: str) -> dict[str, Element]:
    """Return name -> element of each element of a kind."""
    return {each.item_name: each for _, each in model.identifiable_elements if each.element_name == kind}


def find(element: Element, path: str) -> Iterator[Element]:
    """Yield the elements below another one, by their names; "@" follows the reference."""
    first, _, rest = path.partition("/")
    if first == "@":
        found = [element.reference_target]
    else:
        found = [each for each in element.sub_elements if each.element_name == first]
    for each in found:
        yield from find(each, rest) if rest else (each,)


def one(element: Element, path: str) -> Element:
    """Return the only element below another one."""
    (found,) = find(element, path)
    return found


def text(element: Element, path: str) -> str:
    """Return the text of the only element below another one."""
    return str(one(element, path).character_data)


PROPS = "SW-DATA-DEF-PROPS/SW-DATA-DEF-PROPS-VARIANTS/SW-DATA-DEF-PROPS-CONDITIONAL"


@dataclass
class Rte:
    """Header and source of an RTE for the only application component of a model."""

    model: Any
    header: list[str] = field(default_factory=lambda: [PRELUDE])
    source: list[str] = field(default_factory=list)
    made: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        (self.component,) = named(self.model, "APPLICATION-SW-COMPONENT-TYPE").values()
        self.behavior = one(self.component, "INTERNAL-BEHAVIORS/SWC-INTERNAL-BEHAVIOR")
        self.source.append(f'#include "Rte_{self.component.item_name}.h"\n#include "stub.h"\n')
        if list(find(self.behavior, "PORT-API-OPTIONS")):
            self.source.append(STATUS)
        self.implementations = {
            one(each, "APPLICATION-DATA-TYPE-REF/@").path: one(each, "IMPLEMENTATION-DATA-TYPE-REF/@")
            for _, each in self.model.elements_dfs
            if each.element_name == "DATA-TYPE-MAP"
        }
        self.initial = {
            one(each, "PARAMETER-REF/@").path: [
                str(value.character_data)
                for _, value in each.elements_dfs
                if value.element_name == "V" and value.parent.element_name == "SW-VALUES-PHYS"
            ]
            for _, each in self.model.elements_dfs
            if each.element_name == "PARAMETER-PROVIDE-COM-SPEC"
        }
        self.stub = ["#ifndef STUB_H", "#define STUB_H", f'#include "Rte_{self.component.item_name}.h"']
        self._types()
        for runnable in find(self.behavior, "RUNNABLES/RUNNABLE-ENTITY"):
            self._runnable(runnable)
        self.header.append("#endif")
        self.stub.append("#endif")

    def files(self) -> dict[str, str]:
        """Return path -> text."""
        return {
            f"rte/Rte_{self.component.item_name}.h": "\n".join(self.header),
            "rte/stub.h": "\n".join(self.stub),
            "rte/stub.c": "\n".join(self.source),
        }

    def declare(self, prototype: str) -> None:
        self.header.append(f"{prototype};")

    def _types(self) -> None:
        for each in named(self.model, "IMPLEMENTATION-DATA-TYPE").values():
            category = text(each, "CATEGORY")
            if list(find(each, "TYPE-EMITTER")):
                continue  # a platform type
            if category == "STRUCTURE":
                parts = find(each, "SUB-ELEMENTS/IMPLEMENTATION-DATA-TYPE-ELEMENT")
                types = ((one(part, PROPS + "/IMPLEMENTATION-DATA-TYPE-REF/@").item_name, part.item_name) for part in parts)
                fields = " ".join(f"{kind} {name};" for kind, name in types)
                self.header.append(f"typedef struct {{ {fields} }} {each.item_name};")
            elif category == "ARRAY":
                self.header.append(f"typedef {self.item(each)[0]} {each.item_name}{self.item(each)[1]};")
            else:
                self.header.append(
                    f"typedef {text(one(each, PROPS + '/BASE-TYPE-REF/@'), 'NATIVE-DECLARATION')} {each.item_name};"
                )
                for scale in find(each, PROPS + "/COMPU-METHOD-REF/@/COMPU-INTERNAL-TO-PHYS/COMPU-SCALES/COMPU-SCALE"):
                    self.header.append(f"#define {text(scale, 'COMPU-CONST/VT')} {text(scale, 'LOWER-LIMIT')}u")

    def item(self, array: Element) -> tuple[str, str]:
        """Return the type of an array's numbers and its dimensions."""
        part, sizes = one(array, "SUB-ELEMENTS/IMPLEMENTATION-DATA-TYPE-ELEMENT"), ""
        sizes = f"[{text(part, 'ARRAY-SIZE')}]"
        if text(part, "CATEGORY") == "ARRAY":
            kind, more = self.item(part)
            return kind, sizes + more
        return one(part, PROPS + "/IMPLEMENTATION-DATA-TYPE-REF/@").item_name, sizes

    def implementation(self, prototype: Element) -> Element:
        """Return the implementation data type of a data prototype."""
        of = one(prototype, "TYPE-TREF/@")
        return self.implementations.get(of.path, of)

    def _runnable(self, runnable: Element) -> None:
        self.declare(f"void {text(runnable, 'SYMBOL')}(void)")
        variable, body = "VARIABLE-ACCESS/ACCESSED-VARIABLE/AUTOSAR-VARIABLE-IREF", f"{text(runnable, 'SYMBOL')}();"
        for access in find(runnable, f"DATA-RECEIVE-POINT-BY-ARGUMENTS/{variable}"):
            self._received(one(access, "PORT-PROTOTYPE-REF/@"), one(access, "TARGET-DATA-PROTOTYPE-REF/@"))
        for access in find(runnable, f"DATA-READ-ACCESSS/{variable}"):
            port = one(access, "PORT-PROTOTYPE-REF/@")
            self._received(port, one(access, "TARGET-DATA-PROTOTYPE-REF/@"), runnable.item_name)
            body = f"rte_{port.item_name}_fill(); {body}"
        for access in find(runnable, f"DATA-WRITE-ACCESSS/{variable}"):
            port, element = one(access, "PORT-PROTOTYPE-REF/@"), one(access, "TARGET-DATA-PROTOTYPE-REF/@")
            self._written(runnable.item_name, port.item_name, element)
        for access in find(runnable, "PARAMETER-ACCESSS/PARAMETER-ACCESS/ACCESSED-PARAMETER/AUTOSAR-PARAMETER-IREF"):
            self._parameter(one(access, "PORT-PROTOTYPE-REF/@").item_name, one(access, "TARGET-DATA-PROTOTYPE-REF/@"))
        for call in find(runnable, "SERVER-CALL-POINTS/SYNCHRONOUS-SERVER-CALL-POINT/OPERATION-IREF"):
            self._called(one(call, "CONTEXT-R-PORT-REF/@").item_name, one(call, "TARGET-REQUIRED-OPERATION-REF/@"))
        self.stub.append(f"extern void rte_Run_{runnable.item_name}(void);")
        self.source.append(f"void rte_Run_{runnable.item_name}(void) {{ {body} }}")

    def _received(self, port: Element, element: Element, runnable: str = "") -> None:
        """Make the reception of a message; a runnable is given if it has implicit access."""
        name, of = port.item_name, self.implementation(element)
        if list(find(port, "REQUIRED-COM-SPECS/QUEUED-RECEIVER-COM-SPEC")):
            assert not runnable
            length = text(port, "REQUIRED-COM-SPECS/QUEUED-RECEIVER-COM-SPEC/QUEUE-LENGTH")
            kind, size = self.item(of)
            assert (text(element, PROPS + "/SW-IMPL-POLICY"), kind) == ("QUEUED", "uint8")
            self.declare(f"Std_ReturnType Rte_Receive_{name}_{element.item_name}(uint8 *data)")
            names = ("read", "written")
            self.stub.append(f"extern uint8 rte_{name}[{length}]{size};")
            self.stub.append("".join(f"extern uint32 rte_{name}_{each};" for each in names))
            self.source.append(f"uint8 rte_{name}[{length}]{size}; uint32 rte_{name}_read; uint32 rte_{name}_written;")
            self.source.append(QUEUE.format(port=name, element=element.item_name, length=length))
            return
        options = list(find(self.behavior, "PORT-API-OPTIONS/PORT-API-OPTION"))
        (option,) = (each for each in options if one(each, "PORT-REF/@").path == port.path)
        assert text(option, "ERROR-HANDLING") == "TRANSFORMER-ERROR-HANDLING"
        self.stub.append(f"extern {of.item_name} rte_{name}; extern uint8 rte_{name}_code, rte_{name}_status;")
        self.source.append(f"{of.item_name} rte_{name}; uint8 rte_{name}_code = 0x25u, rte_{name}_status;")
        read = f"{name}_{element.item_name}"
        if runnable:
            assert text(port, "REQUIRED-COM-SPECS/NONQUEUED-RECEIVER-COM-SPEC/HANDLE-DATA-STATUS") == "true"
            self.declare(f"const {of.item_name} *Rte_IRead_{runnable}_{read}(void)")
            self.declare(f"Std_ReturnType Rte_IStatus_{runnable}_{read}(Std_TransformerError *error)")
        else:
            self.declare(f"Std_ReturnType Rte_Read_{read}({of.item_name} *data, Std_TransformerError *error)")
        api = BUFFER if runnable else LAST
        self.source.append(api.format(port=name, element=element.item_name, type=of.item_name, runnable=runnable))

    def _written(self, runnable: str, port: str, element: Element) -> None:
        of = self.implementation(element)
        is_array = text(of, "CATEGORY") == "ARRAY"
        kind, sizes = self.item(of) if is_array else (of.item_name, "")
        self.declare(f"void Rte_IWrite_{runnable}_{port}_{element.item_name}(const {kind} *data)")
        self.stub.append(f"extern {kind} rte_{port}{sizes};")
        copy = f"uint32 k; for (k = 0u; k < sizeof(rte_{port}); k++) {{ rte_{port}[k] = data[k]; }}"
        body = copy if is_array else f"rte_{port} = *data;"
        self.source.append(f"{kind} rte_{port}{sizes};")
        self.source.append(f"void Rte_IWrite_{runnable}_{port}_{element.item_name}(const {kind} *data) {{ {body} }}")

    def _parameter(self, port: str, parameter: Element) -> None:
        of, name = self.implementation(parameter), f"rte_{parameter.item_name}"
        if parameter.path in self.made:  # several runnables use it
            return
        self.made.add(parameter.path)
        is_array = text(of, "CATEGORY") == "ARRAY"
        kind, sizes = self.item(of) if is_array else (of.item_name, "")
        values = ", ".join(self.initial[parameter.path])
        prototype = f"{f'const {kind} *' if is_array else f'{kind} '}Rte_Prm_{port}_{parameter.item_name}(void)"
        self.declare(prototype)
        self.stub.append(f"extern {kind} {name}{sizes};")
        self.source.append(f"{kind} {name}{sizes} = {{ {values} }};")
        self.source.append(f"{prototype} {{ return {name}; }}")

    def _called(self, port: str, operation: Element) -> None:
        argument = one(operation, "ARGUMENTS/ARGUMENT-DATA-PROTOTYPE")
        kind = one(argument, "TYPE-TREF/@").item_name
        prototype = f"Std_ReturnType Rte_Call_{port}_{operation.item_name}({kind} {argument.item_name})"
        self.declare(prototype)
        self.stub.append(f"extern uint8 rte_{port};")
        self.source.append(f"uint8 rte_{port};\n{prototype} {{ rte_{port} = {argument.item_name}; return 0u; }}")


_CHECKS = {E2eStatus.OK: 0, E2eStatus.INITIAL: 0, E2eStatus.OK_SOME_LOST: 0, E2eStatus.NO_NEW_DATA: 5, E2eStatus.WRONG_CRC: 3}
_CHECKS |= {E2eStatus.REPEATED: 1, E2eStatus.SYNC: 2, E2eStatus.WRONG_SEQUENCE: 2}
_STATES = {E2eState.VALID: 0x00, E2eState.NO_DATA: 0x20, E2eState.INIT: 0x30, E2eState.INVALID: 0x40}


_PROFILES: Mapping[tuple[str, str], ProfileName] = {
    ("PROFILE_01", "ALL-16-BIT"): "1A",
    ("PROFILE_01", "ALTERNATING-8-BIT"): "1B",
    ("PROFILE_01", "LOWER-12-BIT"): "1C",
    ("PROFILE_02", ""): "2",
    ("PROFILE_05", ""): "5",
    ("PROFILE_11", "ALL-16-BIT"): "11A",
    ("PROFILE_11", "LOWER-12-BIT"): "11C",
}
"""Profile of the bench by its name in the ARXML and the mode of its data id; profiles without variants have none."""


class Transformer:
    """E2E transformer of a received message: code of E2EXf_Inv for each cycle.

    In a cycle without a frame, an RTE passes no data, or with `checks_again` the last data.
    """

    def __init__(self, message: Message, settings: E2e, checks_again: bool) -> None:
        self._data_id = data_id_of(message)
        self._receiver, self._supervision = Receiver(settings, message.length), Supervision(settings)
        self._checks_again, self._last = checks_again, None

    def code(self, data: bytes | None) -> int:
        """Return the code of a cycle with a frame, or without one."""
        passed = data if data is not None or not self._checks_again else self._last
        self._last = passed
        status = self._receiver.no_new_data() if passed is None else self._receiver.check(self._data_id, passed)
        check = _CHECKS[status]
        return _STATES[self._supervision.step(check == 0, check == 3)] | check


def settings_of(model: Any) -> E2e:
    """Return the settings of the E2E transformer in the ARXML."""
    (each,) = (each for _, each in model.elements_dfs if each.element_name == "END-TO-END-TRANSFORMATION-DESCRIPTION")
    mode = [str(found.character_data) for found in find(each, "DATA-ID-MODE")]
    profile = _PROFILES[text(each, "PROFILE-NAME"), *(mode or [""])]
    step, unused = "max_delta_counter_init", {"max_delta_counter"}
    if profile in ("5", "11A", "11C"):
        step, unused = "max_delta_counter", {"max_delta_counter_init", "max_no_new_or_repeated_data", "sync_counter_init"}
    names = {name: name.upper().replace("_", "-") for name in E2e.model_fields.keys() - unused - {"profile"}}
    names |= {step: "MAX-DELTA-COUNTER", "window_size": "WINDOW-SIZE-VALID"}
    return E2e(profile=profile, **{name: int(text(each, tag)) for name, tag in names.items()})


def data_id_of(message: Message) -> DataId:
    """Return the data id of a message in the ARXML, or its list of data ids."""
    ids = message.autosar.e2e.data_ids
    return ids[0] if len(ids) == 1 else bytes(ids)


class Com:
    """COM and E2E transformer between frames and the storage of the RTE."""

    def __init__(self, library: Any, model: Any, arxml: Path, checks_again: bool = False) -> None:
        self._lib = library
        self._database = cantools.database.load_file(arxml)
        settings = settings_of(model)
        self._profile = settings.definition
        self._transformers = {
            message.name: Transformer(message, settings, checks_again)
            for message in self._database.messages
            if message.senders == ["Car"]
        }
        self._counter = 0

    def receive(self, frames: Mapping[int, bytes]) -> None:
        """Pass the frames of a cycle by identifier."""
        for name, transformer in self._transformers.items():
            message = self._database.get_message_by_name(name)
            data = frames.get(message.frame_id)
            setattr(self._lib, f"rte_{name}_code", transformer.code(data))
            if data is not None:
                codes, record = message.decode(data, scaling=False, decode_choices=False), getattr(self._lib, f"rte_{name}")
                for signal in set(codes) & set(dir(record)):
                    setattr(record, signal, codes[signal])
                # handleInvalid KEEP: the data are passed, with RTE_E_INVALID while one of the signals has its invalid value.
                is_invalid = any(each.invalid is not None and codes[each.name] == each.raw_invalid for each in message.signals)
                setattr(self._lib, f"rte_{name}_status", int(is_invalid))  # RTE_E_INVALID is 1

    def send(self) -> tuple[int, bytes]:
        """Return identifier and data of the frame that the component has written."""
        (message,) = (each for each in self._database.messages if each.senders != ["Car"])
        record = getattr(self._lib, f"rte_{message.name}")
        codes = {each.name: int(getattr(record, each.name, 0)) for each in message.signals}
        data = protect(data_id_of(message), self._counter, message.encode(codes, scaling=False), self._profile)
        self._counter = next_counter(self._counter, self._profile)
        return message.frame_id, data
