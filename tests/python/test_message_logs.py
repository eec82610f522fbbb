"""Logs of messages: PX4 ulog, bags of ROS, MCAP and CAN buses. Each signal has the clock of its message."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import can
import cantools
import numpy as np
import pmsm_rs as pm
import pytest
from conftest import MACHINE, Columns, Ran
from mcap.writer import Writer as McapWriter
from pmsm_rs.io.formats import isolated
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START = 1_700_000_000_000_000_000
SLOW = 50
"""Rows of the drive per value of the temperature."""
Write = Callable[[Path, Columns], Path]

DRIVE = """std_msgs/Header header
float64 v_d
float64 v_q
float64 i_d
float64 i_q
float64 theta_e
float64 omega_e
bool enabled
string mode
"""
FIELDS = ("v_d", "v_q", "i_d", "i_q", "theta_e", "omega_e")


def stamps(columns: Columns) -> list[int]:
    return [START + round(1e9 * t) for t in columns["t"]]


def ulog(folder: Path, columns: Columns) -> Path:
    """As docs.px4.io describes the format: formats, subscriptions, data."""
    formats = [
        "motor:uint64_t timestamp;" + "".join(f"double {name};" for name in FIELDS) + "bool enabled;",
        "winding:uint64_t timestamp;float temperature_winding;",
    ]

    def part(kind: bytes, content: bytes) -> bytes:
        return struct.pack("<Hc", len(content), kind) + content

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + part(b"B", bytes(40))
    out += b"".join(part(b"F", text.encode()) for text in formats)
    out += part(b"A", struct.pack("<BH", 0, 0) + b"motor") + part(b"A", struct.pack("<BH", 0, 1) + b"winding")
    for k, t in enumerate(columns["t"]):
        micros = 123_456_789 + round(1e6 * t)
        values = [columns[name][k] for name in FIELDS]
        out += part(b"D", struct.pack("<HQ6d?", 0, micros, *values, True))
        if k % SLOW == 0:
            out += part(b"D", struct.pack("<HQf", 1, micros, 40.0 + k / SLOW))
    path = folder / "flight.ulg"
    path.write_bytes(out)
    return path


def drive_store(stores: Stores) -> object:
    store = get_typestore(stores)
    store.register(get_types_from_msg(DRIVE, "drive_msgs/msg/State"))
    return store


def ros_messages(store: object, columns: Columns, first: bool) -> list[tuple[str, int, object]]:
    """Topic, log time and message; messages come late, and some overtake others."""
    types = store.types  # type: ignore[attr-defined]
    out = []
    for k, now in enumerate(stamps(columns)):
        time = types["builtin_interfaces/msg/Time"](now // 10**9, now % 10**9)
        head = {"seq": k} if first else {}
        header = types["std_msgs/msg/Header"](**head, stamp=time, frame_id="motor")
        values = {name: columns[name][k] for name in FIELDS}
        state = types["drive_msgs/msg/State"](header=header, **values, enabled=True, mode="foc")
        out.append(("/drive/state", now + 700_000 * (k % 3), state))
        if k % SLOW == 0:
            reading = types["std_msgs/msg/Float64"](40.0 + k / SLOW)
            out.append(("/drive/temperature_winding", now, reading))
    return out


def bag(folder: Path, columns: Columns) -> Path:
    store = drive_store(Stores.ROS1_NOETIC)
    path = folder / "run.bag"
    with BagWriter(path) as writer:
        made = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in (
                ("/drive/state", "drive_msgs/msg/State"),
                ("/drive/temperature_winding", "std_msgs/msg/Float64"),
            )
        }
        for topic, logged, message in ros_messages(store, columns, first=True):
            writer.write(made[topic], logged, store.serialize_ros1(message, made[topic].msgtype))
    return path


def bag2(plugin: StoragePlugin) -> Write:
    def write(folder: Path, columns: Columns) -> Path:
        store = drive_store(Stores.ROS2_HUMBLE)
        with Bag2Writer(folder / "run", version=9, storage_plugin=plugin) as writer:
            made = {
                topic: writer.add_connection(topic, kind, typestore=store)
                for topic, kind in (
                    ("/drive/state", "drive_msgs/msg/State"),
                    ("/drive/temperature_winding", "std_msgs/msg/Float64"),
                )
            }
            for topic, logged, message in ros_messages(store, columns, first=False):
                writer.write(made[topic], logged, store.serialize_cdr(message, made[topic].msgtype))
        return next((folder / "run").glob("*.db3" if plugin is StoragePlugin.SQLITE3 else "*.mcap"))

    return write


def mcap_json(folder: Path, columns: Columns) -> Path:
    path = folder / "run.mcap"
    with path.open("wb") as handle:
        writer = McapWriter(handle)
        writer.start()
        schema = writer.register_schema("state", "jsonschema", b'{"type": "object"}')
        drive = writer.register_channel("drive", "json", schema)
        slow = writer.register_channel("thermo", "json", schema)
        for k, now in enumerate(stamps(columns)):
            values = {name: columns[name][k] for name in FIELDS}
            writer.add_message(drive, now, json.dumps(values).encode(), now)
            if k % SLOW == 0:
                reading = {"temperature_winding": 40.0 + k / SLOW}
                writer.add_message(slow, now, json.dumps(reading).encode(), now)
        writer.finish()
    return path


DBC = """VERSION ""

BU_: Drive

BO_ 256 Voltages: 8 Drive
 SG_ v_d : 0|32@1- (0.000001,0) [0|0] "V" Logger
 SG_ v_q : 32|32@1- (0.000001,0) [0|0] "V" Logger

BO_ 257 Currents: 8 Drive
 SG_ i_d : 0|32@1- (0.000001,0) [0|0] "A" Logger
 SG_ i_q : 32|32@1- (0.000001,0) [0|0] "A" Logger

BO_ 258 Motion: 8 Drive
 SG_ theta_e : 0|32@1- (0.000001,0) [0|0] "rad" Logger
 SG_ omega_e : 32|32@1- (0.000001,0) [0|0] "rad/s" Logger

BO_ 2566844674 Thermo: 3 Drive
 SG_ selector M : 0|8@1+ (1,0) [0|0] "" Logger
 SG_ temperature_winding m0 : 8|16@1- (0.1,0) [0|0] "degC" Logger
 SG_ humidity m1 : 8|16@1- (0.1,0) [0|0] "%" Logger
"""


def can_log(name: str) -> Write:
    """A log whose kind python-can knows by its suffix; the frames of one moment follow each other."""

    def write(folder: Path, columns: Columns) -> Path:
        (folder / "drive.dbc").write_text(DBC)
        base = cantools.database.load_string(DBC)
        path = folder / name
        pairs = (("Voltages", "v_d", "v_q"), ("Currents", "i_d", "i_q"), ("Motion", "theta_e", "omega_e"))

        def frame(message: str, seconds: float, **values: float) -> can.Message:
            known = base.get_message_by_name(message)
            return can.Message(
                timestamp=START // 10**9 + seconds,
                arbitration_id=known.frame_id,
                is_extended_id=known.is_extended_frame,
                data=known.encode(values),
                channel=1,
            )

        with can.Logger(path) as log:
            for k, t in enumerate(columns["t"].tolist()):
                for message, one, other in pairs:
                    log.on_message_received(
                        frame(message, t, **{one: columns[one][k], other: columns[other][k]})
                    )
                if k % SLOW == 0:
                    reading = {"temperature_winding": 40.0 + k / SLOW}
                    log.on_message_received(frame("Thermo", t, selector=0, **reading))
                    log.on_message_received(frame("Thermo", t, selector=1, humidity=31.0))
                log.on_message_received(can.Message(timestamp=START // 10**9 + t, arbitration_id=0x7FF))
        return path

    return write


LOGS: dict[str, Write] = {
    "ulog": ulog,
    "bag of ROS 1": bag,
    "bag of ROS 2 in SQLite": bag2(StoragePlugin.SQLITE3),
    "bag of ROS 2 in MCAP": bag2(StoragePlugin.MCAP),
    "MCAP with JSON": mcap_json,
    "CAN log of Vector, binary": can_log("bus.blf"),
    "CAN log of Vector, text": can_log("bus.asc"),
    "CAN log of candump": can_log("bus.log"),
    "CAN log of PEAK": can_log("bus.trc"),
    "CAN log as CSV": can_log("bus.csv"),
    "CAN log in MDF": can_log("bus.mf4"),
}


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    path = tmp_path / "machine.toml"
    temperature = 'temperature = { from = "temperature_winding", unit = "degC" }'
    path.write_text(f'{MACHINE}\n[columns]\ndbc = "drive.dbc"\n{temperature}\n')
    return path


@pytest.mark.parametrize("kind", LOGS)
def test_every_signal_is_read_on_its_own_clock(
    kind: str, columns: Columns, tmp_path: Path, machine: Path
) -> None:
    path = LOGS[kind](tmp_path, columns)
    if kind.startswith("bag"):
        text = machine.read_text().replace("temperature_winding", "drive/temperature_winding/data")
        machine.write_text(text)
    recording = pm.load(path, machine)
    rows = len(recording.column("t"))
    # Behind its last value nothing is known of the temperature.
    assert rows > len(columns["t"]) - SLOW
    np.testing.assert_allclose(
        recording.column("t") - recording.column("t")[0], columns["t"][:rows], atol=2e-6
    )
    for name in FIELDS:
        np.testing.assert_allclose(recording.column(name), columns[name][:rows], atol=2e-6)
    reached = recording.column("temperature")
    last = len(columns["t"]) - SLOW
    np.testing.assert_allclose(reached[:last], 40.0 + columns["t"][:last] / (1e-3 * SLOW), atol=2e-3)
    [told] = [r.finding for r in recording.account.remarks if "interpolated" in r.finding]
    assert "20 Hz" in told
    assert "1000 Hz" in told


def test_joints_go_by_their_names(columns: Columns, tmp_path: Path, run: Callable[..., Ran]) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    with Bag2Writer(tmp_path / "arm", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        made = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for k, now in enumerate(stamps(columns)):
            time = types["builtin_interfaces/msg/Time"](now // 10**9, now % 10**9)
            message = types["sensor_msgs/msg/JointState"](
                header=types["std_msgs/msg/Header"](stamp=time, frame_id=""),
                name=["hip", "knee"],
                position=np.array([columns["theta_e"][k], 0.0]),
                velocity=np.array([columns["omega_e"][k], 0.0]),
                effort=np.array([columns["i_q"][k], 0.0]),
            )
            writer.write(made, now, store.serialize_cdr(message, made.msgtype))
    [path] = (tmp_path / "arm").glob("*.mcap")
    shown = run("inspect", path).out
    assert "velocity[hip]" in shown
    machine = tmp_path / "m.toml"
    machine.write_text(
        f'{MACHINE}\n[columns]\nomega_m = {{ from = "velocity[hip]", unit = "rad/s" }}\n'
        'tau_e = { from = "effort[hip]", unit = "N·m" }\n'
    )
    np.testing.assert_allclose(pm.load(path, machine).column("omega_m"), columns["omega_e"])


def test_a_can_log_needs_its_description(
    columns: Columns, tmp_path: Path, machine: Path, run: Callable[..., Ran]
) -> None:
    path = LOGS["CAN log of candump"](tmp_path, columns)
    with pytest.raises(pm.DataError, match=r'dbc = "FILE.dbc" in \[columns\]'):
        pm.load(path)
    written = tmp_path / "written.toml"
    assert run("inspect", path, "--machine", machine, "--write", written).code == 0
    assert {*FIELDS} <= {*pm.load(path, written).names}
    machine.write_text(machine.read_text().replace("drive.dbc", "other.dbc"))
    with pytest.raises(pm.UsageError, match=r"other\.dbc: there is no such file"):
        pm.load(path, machine)
    (tmp_path / "other.dbc").write_text("VERSION 7 BO_ nonsense")
    with pytest.raises(pm.DataError, match=r"other\.dbc cannot be read .*correct dbc in \[columns\]"):
        pm.load(path, machine)
    others = DBC.replace("2566844674", "2566844673")
    for number in (256, 257, 258):
        others = others.replace(f"BO_ {number} ", f"BO_ {number + 100} ")
    (tmp_path / "other.dbc").write_text(others)
    with pytest.raises(pm.DataError, match=r"none of its \d+ frames is described"):
        pm.load(path, machine)


def test_another_kind_of_description_is_an_error_of_the_machine_file(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(f"{MACHINE}\n[columns]\ndbc = 7\n")
    with pytest.raises(pm.MachineError, match=r"columns\.dbc: write it as"):
        pm.load(path, path)


def test_a_description_is_a_part_of_the_question(tmp_path: Path, machine: Path) -> None:
    from pmsm_rs.config.machine_file import read_machine
    from pmsm_rs.fleet.crew import Task

    (tmp_path / "drive.dbc").write_text(DBC)
    fields = dict.fromkeys(("recording", "validation"), None)
    known = {name: fields.get(name) for name in Task.__dataclass_fields__}
    keys = []
    for text in (DBC, DBC.replace("0.1,0", "0.2,0")):
        (tmp_path / "drive.dbc").write_text(text)
        keys.append(Task(**{**known, "machine": read_machine(machine), "seed": 1}).key())
    assert keys[0] != keys[1]


@pytest.mark.parametrize("kind", ["ulog", "bag of ROS 1", "bag of ROS 2 in SQLite", "MCAP with JSON"])
def test_a_log_that_is_cut_short_is_refused_or_read_as_far_as_it_goes(
    kind: str, columns: Columns, tmp_path: Path
) -> None:
    path = LOGS[kind](tmp_path, columns)
    whole = path.read_bytes()
    for share in (0.02, 0.5, 0.98):
        path.write_bytes(whole[: int(share * len(whole))])
        with suppress(pm.DataError):
            assert len(pm.load(path).column("t")) <= len(columns["t"])


@pytest.mark.parametrize(
    ("kind", "library", "extra"),
    [
        ("ulog", "pyulog", "ulog"),
        ("bag of ROS 1", "rosbags", "ros"),
        ("MCAP with JSON", "mcap", "mcap"),
        ("CAN log of candump", "can", "can"),
    ],
)
def test_a_missing_library_is_named_with_the_extra_that_brings_it(
    kind: str,
    library: str,
    extra: str,
    columns: Columns,
    tmp_path: Path,
    machine: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = LOGS[kind](tmp_path, columns)
    monkeypatch.setattr(isolated, "find_spec", lambda _name: None)
    with pytest.raises(pm.UsageError, match=rf"{library}, .*pip install 'pmsm-rs\[{extra}\]'"):
        pm.load(path, machine)
