"""Frames, parameters, missions, clock and file transfer as a client sees them."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sitl.vehicle_parameters import INT32, REAL32, VehicleParameters
from sitl.wire import Sender, layout, x25_crc
from tests.unit.sitl_rig import ARM, NAN, Station


@given(st.binary(max_size=300))
def test_crc_is_the_dialects(data):
    assert x25_crc(data) == dialect.x25crc(data).crc


def test_every_message_of_the_dialect_frames_and_parses():
    parser = dialect.MAVLink(None)
    sender = Sender(1, 1)
    for number, message_class in dialect.mavlink_map.items():
        message = layout(message_class.msgname)
        (parsed,) = parser.parse_buffer(sender.frame(message, message.payload()))
        assert parsed.get_msgId() == number


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("ODOMETRY", {"time_usec": 5, "q": [0.5, 0.1, 0.2, 0.3], "pose_covariance": list(range(21)), "quality": -3}),
        ("STATUSTEXT", {"severity": 4, "text": "hello"}),
        ("BATTERY_STATUS", {"voltages": list(range(10)), "current_battery": -1, "battery_remaining": 77}),
        ("AUTOPILOT_VERSION", {"capabilities": 2**40, "uid": 3, "flight_custom_version": list(b"rotorlab")}),
        ("PARAM_VALUE", {"param_id": "MIS_TAKEOFF_ALT", "param_value": 2.5, "param_index": 4}),
    ],
)
def test_fields_arrive_where_they_belong(name, fields):
    message = layout(name)
    (parsed,) = dialect.MAVLink(None).parse_buffer(Sender(1, 1).frame(message, message.payload(**fields)))
    for key, value in fields.items():
        assert getattr(parsed, key) == (pytest.approx(value) if not isinstance(value, str) else value)


def test_unknown_field_and_message_are_errors():
    with pytest.raises(KeyError, match="no field 'colour'"):
        layout("PING").payload(colour=3)
    with pytest.raises(KeyError, match="NO_SUCH"):
        layout("NO_SUCH")


def test_parameters_read_set_and_list():
    station = Station()
    station.run(0.1)
    station.send(dialect.MAVLink_param_request_list_message(1, 1))
    station.run(0.02)
    listed = station.all("PARAM_VALUE")
    assert [m.param_index for m in listed] == list(range(listed[0].param_count))
    station.received.clear()
    station.send(dialect.MAVLink_param_request_read_message(1, 1, b"SYS_AUTOSTART", -1))
    station.send(dialect.MAVLink_param_request_read_message(1, 1, b"NO_SUCH_PARAM", -1))
    carried = struct.unpack("<f", struct.pack("<i", 2))[0]
    station.send(dialect.MAVLink_param_set_message(1, 1, b"COM_RC_OVERRIDE", carried, INT32))
    station.send(dialect.MAVLink_param_set_message(1, 1, b"MIS_TAKEOFF_ALT", 500.0, REAL32))
    station.run(0.02)
    values = {m.param_id: m for m in station.all("PARAM_VALUE")}
    assert struct.unpack("<i", struct.pack("<f", values["SYS_AUTOSTART"].param_value))[0] == 4001
    assert struct.unpack("<i", struct.pack("<f", values["COM_RC_OVERRIDE"].param_value))[0] == 2
    assert values["MIS_TAKEOFF_ALT"].param_value == 2.5
    assert "NO_SUCH_PARAM" not in values
    assert station.texts() == ["MIS_TAKEOFF_ALT: value or type refused"]


@given(st.integers(-(2**31), 2**31 - 1))
def test_integers_travel_bytewise(value):
    carried = struct.unpack("<f", struct.pack("<i", value))[0]
    if carried == carried:  # a NaN pattern keeps its bits on the wire but not in a Python float
        assert VehicleParameters.value_from_wire(carried, INT32) == value


def test_timesync_ping_and_file_transfer():
    station = Station()
    station.run(1.0)
    station.send(dialect.MAVLink_timesync_message(0, 77))
    station.send(dialect.MAVLink_timesync_message(5, 78))
    station.send(dialect.MAVLink_ping_message(123, 9, 0, 0))
    station.send(dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, [5, 0, 0, 4, *[0] * 247]))
    station.run(0.02)
    (sync,) = station.all("TIMESYNC")
    assert (sync.tc1, sync.ts1) == (1_000_000_000, 77)
    (ping,) = station.all("PING")
    assert (ping.seq, ping.target_system) == (9, 255)
    (refusal,) = station.all("FILE_TRANSFER_PROTOCOL")
    assert refusal.payload[3] == 129
    assert refusal.payload[0] == 6


def item(sequence: int, command: int = 16, latitude: int = 473977420, mission_type: int = 0):
    return dialect.MAVLink_mission_item_int_message(
        1, 1, sequence, 6, command, 0, 1, 0, 0, 0, NAN, latitude, 85455940, 3.0, mission_type
    )


def test_mission_upload_asks_again_for_a_lost_item_and_downloads_the_same():
    station = Station()
    station.run(0.1)
    station.send(dialect.MAVLink_mission_count_message(1, 1, 3))
    for sequence in (0, 1):
        station.send(item(sequence))
    station.run(0.8)
    assert [m.seq for m in station.all("MISSION_REQUEST_INT")] == [0, 1, 2, 2]
    station.send(item(2, latitude=473977999))
    station.run(0.02)
    assert station.all("MISSION_ACK")[-1].type == 0
    station.send(dialect.MAVLink_mission_request_list_message(1, 1))
    station.send(dialect.MAVLink_mission_request_int_message(1, 1, 2))
    station.run(0.02)
    assert station.all("MISSION_COUNT")[-1].count == 3
    assert station.all("MISSION_ITEM_INT")[-1].x == 473977999


def test_mission_upload_that_stops_is_given_up_and_the_old_one_kept():
    station = Station()
    station.run(0.1)
    station.send(dialect.MAVLink_mission_count_message(1, 1, 2))
    station.run(5.0)
    assert station.all("MISSION_ACK")[-1].type == 1
    assert station.simulation.autopilot.mission.items == []


def test_mission_item_it_cannot_fly_is_refused():
    station = Station()
    station.run(0.1)
    station.send(dialect.MAVLink_mission_count_message(1, 1, 1))
    station.send(item(0, command=82))
    station.run(0.02)
    assert station.all("MISSION_ACK")[-1].type == 3
    assert station.mode(4, 4) == 1


def test_home_follows_arming():
    station = Station()
    station.run(0.1)
    station.state[0] = 30.0
    station.run(0.01)
    assert station.command(ARM, 1, 0) == 0
    station.run(2.1)
    assert station.all("HOME_POSITION")[-1].x == pytest.approx(30.0, abs=0.5)
