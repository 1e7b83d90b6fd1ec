"""CDF 2.0 (ASAM Calibration Data Format, `.cdfx`), the XML format of calibration values.

Files are parsed with expat of the standard library. A file that declares an entity, or a default value of an attribute, is
rejected, so nothing can expand.
Expat loads no DTD or other external file.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from codegen import __version__
from codegen.emit.objects import CalibrationObject, Kind, Layout, Numbers, Values
from codegen.errors import CodegenError
from codegen.export.calibration.labels import READ_REMEDY, Label, begins_with, number_text
from codegen.importing.source import refuse_declarations

_BOOLEANS = {"true": "1", "false": "0"}
_KINDS: dict[str, Kind] = {
    "VALUE": "VALUE",
    "BOOLEAN": "VALUE",
    "DEPENDENT_VALUE": "VALUE",
    "COM_AXIS": "AXIS",
    "CURVE": "CURVE",
    "MAP": "MAP",
}
_CATEGORIES: dict[Kind, str] = {"VALUE": "VALUE", "AXIS": "COM_AXIS", "CURVE": "CURVE", "MAP": "MAP"}
"""Categories that are written."""
_DOCTYPE = (
    '<!DOCTYPE MSRSW PUBLIC "-//ASAM//DTD CALIBRATION DATA FORMAT:V2.0.0:LAI:IAI:XML:CDF200.XSD//EN" "cdf_v2.0.0.sl.dtd">\n'
)


def read(content: bytes, path: Path, start: str) -> Iterator[Label]:
    """Yield the values, axes, curves and maps of a file whose names begin with `start`; other instances are skipped, whatever
    they contain. Raises CodegenError: it is damaged."""
    root = _parsed(content, path)
    if root.tag != "MSRSW" or not _text(root, "CATEGORY").startswith("CDF2"):
        raise CodegenError("no MSRSW of category CDF20", where=path, remedy=READ_REMEDY)
    for name, instance in _instances(root, ""):
        category = _text(instance, "CATEGORY")
        if not begins_with(name, start):
            continue
        if category not in _KINDS:
            if instance.find("SW-INSTANCE") is not None:
                continue  # a structure, whose members follow
            what = f"is of category {category or 'none'}"
            raise CodegenError(what, where=f"{path}: {name}", remedy=f"export it as one of {', '.join(_KINDS)}")
        yield _label(instance, name, _KINDS[category], path)


def _instances(parent: ElementTree.Element, prefix: str) -> Iterator[tuple[str, ElementTree.Element]]:
    """Yield all instances with their whole names: that of a structure, a dot, and that of its member."""
    for child in parent:
        name = prefix
        if child.tag == "SW-INSTANCE":
            own = _text(child, "SHORT-NAME")
            name = f"{prefix}.{own}" if prefix and not own.startswith(f"{prefix}.") else own
            yield name, child
        yield from _instances(child, name)


def _parsed(content: bytes, path: Path) -> ElementTree.Element:
    """Return the root of an XML file without such declarations."""
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()
    refuse_declarations(parser, path)
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(content, True)
        return builder.close()
    except expat.ExpatError as error:
        what = f"not well-formed XML ({expat.errors.messages[error.code]})"
        raise CodegenError(what, where=f"{path}, line {error.lineno}", remedy=READ_REMEDY) from None
    except (ValueError, LookupError) as error:  # an encoding that expat or Python does not know
        raise CodegenError(f"not readable as XML ({error})", where=path, remedy="save it as UTF-8") from None


def _text(element: ElementTree.Element, tag: str) -> str:
    return (element.findtext(tag) or "").strip()


def _label(instance: ElementTree.Element, name: str, kind: Kind, path: Path) -> Label:
    variants = instance.findall("SW-INSTANCE-PROPS-VARIANTS/SW-INSTANCE-PROPS-VARIANT")
    if len(variants) > 1:
        raise CodegenError(f"{len(variants)} variants", where=f"{path}: {name}", remedy="export one variant of the calibration")
    holder = variants[0] if variants else instance
    content = holder.find("SW-VALUE-CONT")
    if content is None:
        raise CodegenError("has no SW-VALUE-CONT", where=f"{path}: {name}", remedy=READ_REMEDY)
    if content.find("SW-VALUES-PHYS") is None:
        what = "has no physical values (SW-VALUES-PHYS)"
        raise CodegenError(what, where=f"{path}: {name}", remedy="export physical values, not coded ones")
    axes, points, units = [], [], [_text(content, "UNIT-DISPLAY-NAME")]
    for axis in holder.findall("SW-AXIS-CONTS/SW-AXIS-CONT"):
        axes.append(_text(axis, "SW-INSTANCE-REF"))
        points.append(_numbers(axis))
        units.append(_text(axis, "UNIT-DISPLAY-NAME"))
    return Label(name, kind, str(path), _numbers(content), _size(content, kind), tuple(axes), tuple(points), tuple(units))


def _numbers(element: ElementTree.Element) -> list[str]:
    """Return the texts of all numbers below SW-VALUES-PHYS; those of groups, the rows of a map, one after the other."""
    found = element.find("SW-VALUES-PHYS")
    texts = [] if found is None else [(each.text or "").strip() for each in found.iter() if each.tag in ("V", "VT", "VF", "VH")]
    return [_BOOLEANS.get(text.lower(), text) for text in texts]


def _size(content: ElementTree.Element, kind: Kind) -> tuple[int, ...]:
    """Return the columns and rows of a value: as stated, else those of the groups of a map."""
    stated = [(each.text or "").strip() for each in content.findall("SW-ARRAYSIZE/V")]
    if stated and kind != "VALUE":
        return tuple(int(text) if text.isascii() and text.isdigit() and len(text) < 10 else -1 for text in stated)
    groups = content.findall("SW-VALUES-PHYS/VG")
    lengths = {len(group.findall("V")) for group in groups}
    return (lengths.pop() if len(lengths) == 1 else -1, len(groups)) if groups else ()


def write(values: Values, layout: Layout, title: str) -> bytes:
    """Return the file of a set. The same set gives the same bytes."""
    root = ElementTree.Element("MSRSW", {"CREATOR": "codegen", "CREATOR-VERSION": __version__})
    _add(root, "SHORT-NAME", layout.prefix)
    _add(root, "CATEGORY", "CDF20")
    system = _add(_add(root, "SW-SYSTEMS"), "SW-SYSTEM")
    _add(system, "SHORT-NAME", layout.prefix)
    tree = _add(_add(system, "SW-INSTANCE-SPEC"), "SW-INSTANCE-TREE")
    _add(tree, "SHORT-NAME", layout.prefix)
    _add(tree, "LONG-NAME", title)
    _add(tree, "CATEGORY", "NO_VCD")
    _add(_add(tree, "SW-INSTANCE-TREE-ORIGIN"), "SYMBOLIC-FILE", f"{layout.prefix}.a2l")
    for each in layout.objects.values():
        _add_instance(tree, each, values, layout)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{_DOCTYPE}{text}\n'.encode()


def _add(parent: ElementTree.Element, tag: str, text: str | None = None) -> ElementTree.Element:
    child = ElementTree.SubElement(parent, tag)
    child.text = text
    return child


def _add_instance(tree: ElementTree.Element, each: CalibrationObject, values: Values, layout: Layout) -> None:
    instance = _add(tree, "SW-INSTANCE")
    _add(instance, "SHORT-NAME", each.name)
    _add(instance, "LONG-NAME", each.meaning)
    _add(instance, "CATEGORY", _CATEGORIES[each.kind])
    content = _add(instance, "SW-VALUE-CONT")
    _add(content, "UNIT-DISPLAY-NAME", each.unit)
    if each.shape:
        size = _add(content, "SW-ARRAYSIZE")
        for count in reversed(each.shape):
            _add(size, "V", str(count))
    physical, numbers = _add(content, "SW-VALUES-PHYS"), values[each.name]
    if each.kind == "MAP":
        for breakpoint_, row in zip(values[each.axes[1]], numbers, strict=True):
            group = _add(physical, "VG")
            _add(group, "LABEL", number_text(breakpoint_))
            _add_numbers(group, row)
    else:
        _add_numbers(physical, numbers.reshape(-1))
    if each.axes:
        axes = _add(instance, "SW-AXIS-CONTS")
        for name in each.axes:
            axis = _add(axes, "SW-AXIS-CONT")
            _add(axis, "CATEGORY", "COM_AXIS")
            _add(axis, "UNIT-DISPLAY-NAME", layout.objects[name].unit)
            _add(axis, "SW-INSTANCE-REF", name)


def _add_numbers(parent: ElementTree.Element, numbers: Numbers) -> None:
    for number in numbers:
        _add(parent, "V", number_text(number))
