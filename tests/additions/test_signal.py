"""A signal that is added to the table of signals appears in every product, without a change to any other file."""

from __future__ import annotations

from tests.additions.copy import ROOT, Copy

SIGNAL = """    lateral_speed: Annotated[
        float,
        SignalDefinition(
            "LateralSpeed",
            start_bit=40,
            length=8,
            factor=0.1,
            unit=M_S,
            meaning="lateral speed of the centre of gravity, positive to the left",
            source="state.lateral_speed",
        ),
    ] = math.nan
    reverse_gear: Annotated[
        bool, SignalDefinition("ReverseGear", start_bit=13, length=1, meaning="1 = in reverse gear", values=("no", "yes"))
    ] = False
"""
"""A number that the simulated car has, and a flag that it does not have."""

CHECK = """
import csv
import sys
from pathlib import Path

import asammdf
import cantools
import numpy as np
from pyarrow import parquet
from scipy.io import loadmat

from codegen.emit.from_files import prepare
from codegen.emit.write import write_folder
from codegen.export.arxml import export
from codegen.export.fmu.export import make_fmu
from codegen.export.fmu.variables import variables_of
from codegen.export.runs import EXPORT_COLUMNS, RUN_FORMATS
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import RECORD_COLUMNS, Measurement, compile_build
from codegen.verify.emulated_batches import program_of
from hil_sim.codec import Codec, VehicleConditions
from hil_sim.plant_node import PlantNode
from hil_sim.scenario_files import find
from tests.export.bus import Bus, Node, simulate
from tests.export.fmus import Slave, unpacked


def reread(path, name):
    # A column of a run, by a reader other than its writer.
    if path.suffix == ".mf4":
        with asammdf.MDF(path) as run:
            assert run.get(name).unit == "m/s"
            return run.get(name).samples
    if path.suffix == ".parquet":
        return parquet.read_table(path).column(name).to_numpy()
    if path.suffix == ".mat":
        return loadmat(path)[name][:, 0]
    return np.array([float(row[name]) for row in csv.DictReader(path.open())])


folder = prepare(Path(sys.argv[1])).folder
files = {path: content.decode() for path, content in folder.files.items() if not path.endswith(".npz")}
software = compile_build(folder.files, folder.manifest)
ffi, prefix = software.ffi, software.prefix

# C: both structs, and packing against the codec of the bench and cantools
assert "float lateral_speed;" in files["include/ars_inputs.h"] and "float lateral_speed;" in files["include/ars_can.h"]
sent = VehicleConditions(rear_angle=0.01, friction=0.8, lateral_acceleration=1.0, lateral_speed=-2.3, reverse_gear=True)
signals, back, data = software.new("vehicle_conditions"), software.new("vehicle_conditions"), ffi.new("uint8_t[8]")
for name in software.config.can.vehicle_conditions.signals():
    setattr(signals, name, getattr(sent, name))
software.function("can_pack_vehicle_conditions")(signals, data)
software.function("can_unpack_vehicle_conditions")(data, back)
assert abs(back.lateral_speed + 2.3) < 1e-6 and back.reverse_gear
assert Codec(software.config.can).encode(sent) == bytes(data)
dbc = cantools.database.load_string(files["ars.dbc"])
read = dbc.decode_message("VehicleConditions", bytes(data))
assert abs(read["LateralSpeed"] + 2.3) < 1e-9 and read["ReverseGear"] == "yes"
assert "lateral speed of the centre of gravity" in files["ars.dbc"]

# ARXML: the same frame, and elements of the component's port; the adapter places both codes in the frame
write_folder(folder, Path("added"))
described = export(Path("added")).folder.files
arxml = cantools.database.load_string(described["ars.arxml"].decode(), "arxml")
assert arxml.decode_message("VehicleConditions", bytes(data)) == read
for name in ("LateralSpeed", "ReverseGear"):
    assert f"codes->{name}" in described["src/ars_swc.c"].decode()
    assert f"/Ars/SignalTypes/VehicleConditions/{name}</TYPE-TREF>" in described["ars.arxml"].decode()

# the controller hands it on
controller = software.controller()
controller.step(Measurement(20.0, 0.0, 0.0, lateral_speed=0.5, reverse_gear=True))
assert controller.state.sample.lateral_speed == 0.5 and controller.state.sample.reverse_gear

# A2L and FMU
for name in ("lateral_speed", "reverse_gear"):
    assert f"ars.received.{name}" in files["ars.a2l"]
controls = {each.name: each for each in variables_of("controller", software.config)}
assert controls["lateral_speed_m_s"].unit.symbol == "m/s" and "lateral_speed_available" in controls
assert controls["reverse_gear"].kind == "boolean"
assert "lateral_speed_m_s" in {each.name for each in variables_of("loop", software.config) if each.role == "output"}

# FMUs of both nodes on the bus: frames of the car, and measurements in the A2L of the ECU
bus_car, ecu = (unpacked(Path("fmus").resolve(), what, make_fmu(Path("added"), what, "3")) for what in ("bus_plant", "ecu"))
(measured,) = ecu.folder.glob("extra/*/*/ars.a2l")
assert "ars.received.lateral_speed" in measured.read_text() and "ars.received.reverse_gear" in measured.read_text()
bus = Bus([Node(Slave(what, event_mode=True)).start() for what in (bus_car, ecu)], None)
turn = {"speed_m_s": 20.0, "steering_wheel_command_rad": 0.5}
simulate(bus, 1.0, 0.001, lambda number, time: turn if number == 0 else {})
decoded = [dbc.decode_message(frame.id, frame.data) for frame in bus.frames if frame.id == 0x102]
assert max(abs(each["LateralSpeed"]) for each in decoded) > 0.1, decoded[-1]

# the guide, and the README of the build
from scripts.guide import config_tables, interface_tables
meaning = "lateral speed of the centre of gravity, positive to the left"
assert f"| m/s, {meaning} |" in config_tables.markdown()
assert f"| `lateral_speed_m_s` | m/s | {meaning.capitalize()} |" in interface_tables.run_columns()
interface_tables.BUILD = Path("added")
assert "| `LateralSpeed` | 40 | 8 | Intel | signed | 0.1 | -12.7 to 12.7 m/s | -128 |" in interface_tables.can_matrix()
assert "| `ReverseGear` | 13 | 1 | Intel | unsigned | 1 | 0 no, 1 yes |  |" in interface_tables.can_matrix()
assert "`LateralSpeed` m/s" in files["README.md"] and "`ReverseGear`" in files["README.md"]

# runs: of the closed loop, directly and through frames, and of the car on the bus
assert RECORD_COLUMNS == tuple(column.name for column in EXPORT_COLUMNS)
place, inputs = RECORD_COLUMNS.index("lateral_speed_m_s"), find("step-steer").inputs(software.config)
loop = ClosedLoop(software)
direct = loop.run(inputs)
assert np.abs(direct[:, place]).max() > 0.1
for ending, content in ((ending, each.content(direct, "")) for ending, each in RUN_FORMATS.items()):
    Path(f"run{ending}").write_bytes(content)
    assert (reread(Path(f"run{ending}"), "lateral_speed_m_s") == direct[:, place]).all(), ending
stepped = ClosedLoop(software).run_stepped(inputs)
assert (direct == stepped).all()
through_can = ClosedLoop(software, LoopOptions(through_can=True))
through_can.run(inputs)
received = through_can.state.task.conditions.lateral_speed
assert abs(received - loop.state.plant.lateral_speed) < 0.2
assert through_can.state.task.controller.sample.lateral_speed == received
car = PlantNode(software.config, find("step-steer"))
for cycle in range(car.cycles):
    frame = car.outgoing(cycle)[1]
    row = car.finish(cycle)
assert abs(row[place] - Codec(software.config.can).decode(frame.id, frame.data).lateral_speed) <= 0.05 + 1e-6
assert row[place] != 0.0

# stimuli of the checks
batches = program_of(software, folder.files).batches
assert all(name in batches[batch].inputs for batch in ("controller", "can") for name in ("lateral_speed", "reverse_gear"))
"""


def test_a_signal_is_one_entry_of_the_table(tree: Copy) -> None:
    after = '            in_layout="ESC or ABS is acting",\n        ),\n    ] = False\n'
    tree.after("codegen/configuration/signals.py", after, SIGNAL)
    map_file = ROOT / "generated" / "4ws2-paper.npz"
    tree.run("-c", CHECK, str(map_file))
    tree.commands(
        "check added",
        "sil --build added --csv run.csv --plot run.png",
        "sil --build added --can --sensors -o run.mf4",
        "hil --build added --bus virtual:bench --ecu cffi --lock-step --log run.blf",
        "faults --build added",
        "log run.blf --dbc added/ars.dbc",
        "identify --log run.blf --dbc added/ars.dbc --check",
        f"report --map {map_file} --build added --run run.csv --run bus=run.blf --no-simulation -o report.html",
        "arxml --build added -o arxml",
        "firmware --build added -o firmware",
        "fmu --build added --what plant -o plant.fmu",
    )
    assert len(tree.touched) <= 3
