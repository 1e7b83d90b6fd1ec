"""Layered standards of an FMI 3.0 FMU: FMI-LS-BUS 1.0 (CAN, network abstraction) and FMI-LS-XCP 1.0.

Sources: FMI Layered Standard for Network Communication 1.0.0, sections 4.3, 4.4 and 4.5.1; FMI Layered Standard for XCP 1.0.0,
sections 2 and 3.1.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

CHANNEL = "CanChannel"
"""Name of the bus terminal, and prefix of its variables."""
MIME_TYPE = 'application/org.fmi-standard.fmi-ls-bus.can; version="1.0.0"'
BUFFER_BYTES = 2048
"""Largest size of the operations of one event; CAN_BUFFER_SIZE in can_node.h."""
MEMBERS = ("Rx_Clock", "Rx_Data", "Tx_Clock", "Tx_Data")
"""Members of a bus terminal."""
NOTIFICATIONS = "BusNotifications"
"""Member of the configuration terminal."""

TERMINALS_PATH = "terminalsAndIcons/terminalsAndIcons.xml"
BUS, XCP = "org.fmi-standard.fmi-ls-bus", "org.fmi-standard.fmi-ls-xcp"
DESCRIPTIONS = {
    BUS: "Layered Standard for the simulation of bus communication on a Physical Signal Abstraction or Network Abstraction "
    "based level.",
    XCP: "Layered standard based on FMI 2.0 and FMI 3.0 for describing and implementing XCP support for FMUs, which can either "
    "provide an XCP service or allow direct memory access via A2L files.",
}
_NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"


def manifest_path(standard: str) -> str:
    """Return the path of a standard's manifest in the archive."""
    return f"extra/{standard}/fmi-ls-manifest.xml"


def terminals() -> bytes:
    """Return terminalsAndIcons.xml with the bus terminal."""
    root = ET.Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    about = {"terminalKind": "org.fmi-ls-bus.network-terminal", "matchingRule": "org.fmi-ls-bus.transceiver", "name": CHANNEL}
    terminal = ET.SubElement(ET.SubElement(root, "Terminals"), "Terminal", about)
    for member in MEMBERS:
        _member(terminal, member)
    kind = "org.fmi-ls-bus.network-terminal.configuration"
    inner = ET.SubElement(terminal, "Terminal", {"terminalKind": kind, "matchingRule": "bus", "name": "Configuration"})
    _member(inner, NOTIFICATIONS)
    return text(root)


def _member(terminal: ET.Element, member: str) -> None:
    named = {"variableKind": "signal", "variableName": f"{CHANNEL}.{member}", "memberName": member}
    ET.SubElement(terminal, "TerminalMemberVariable", named)


def bus_manifest() -> bytes:
    """Return the manifest of FMI-LS-BUS."""
    root = _manifest(BUS)
    root.set("isBusSimulationFMU", "false")
    return text(root)


def xcp_manifest(a2l: str) -> bytes:
    """Return the manifest of FMI-LS-XCP for one A2L, whose addresses an XCP service of the importer uses."""
    root = _manifest(XCP)
    about = {"definition": a2l, "description": "memory of the ECU", "supportsDirectMemoryAccess": "true"}
    ET.SubElement(root, "Interface", about)
    return text(root)


def _manifest(standard: str) -> ET.Element:
    facts = {"name": standard, "version": "1.0.0", "description": DESCRIPTIONS[standard]}
    ET.register_namespace("fmi-ls", _NAMESPACE)
    return ET.Element("fmiLayeredStandardManifest", {f"{{{_NAMESPACE}}}fmi-ls-{key}": value for key, value in facts.items()})


def text(root: ET.Element) -> bytes:
    """Return an XML file."""
    ET.indent(root, "  ")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'.encode()
