"""A flight process imitated on its real sockets, for tests of the hub: sends frames, hears commands."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.commands import Answer, Request
from gcs.records import Event, FlightMessage, FlightStart, Packet, Status, TickFrame, TickInputs, TrajectoryStatus
from gcs.runtime import Runtime, open_runtime
from gcs.signals import FRAME_SIZE, SLICES
from models.samples import ImuSample

ROOT = Path(__file__).parents[1]
HEARTBEAT_PACKET = bytes(mavlink.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3).pack(mavlink.MAVLink(None, 1, 1)))


def tick_frame(sequence: int, *, session: str = "life-1", utc_s: float | None = None, **changes: object) -> TickFrame:
    """One tick at 100 Hz with an IMU sample, a packet and signals that carry the sequence number."""
    t_s = 10.0 + 0.01 * sequence
    signals = np.full(FRAME_SIZE, np.nan)
    signals[SLICES["time"]] = t_s
    signals[SLICES["estimate.position_ned"]] = (sequence, 2.0, -3.0)
    imu = ImuSample(time_s=t_s, arrival_s=t_s, gyro_body_rad_s=(0.1, 0.2, 0.3), accel_body_m_s2=(0.0, 0.0, -9.81))
    frame = TickFrame(
        sequence=sequence,
        t_s=t_s,
        utc_s=utc_s if utc_s is not None else 1_700_000_000.0 + t_s,
        inputs=TickInputs(samples=(imu,)),
        output_hash=sequence.to_bytes(8, "little"),
        signals=signals.tobytes(),
        packets=(Packet(1_700_000_000_000_000 + sequence, True, HEARTBEAT_PACKET),),
        session=session,
    )
    return msgspec.structs.replace(frame, **changes)


def flight_start(session: str = "life-1") -> FlightStart:
    return FlightStart(
        session=session,
        utc_s=1_700_000_000.0,
        vehicle_name="test quad",
        vehicle_toml='name = "test quad"\n',
        parameters_toml="",
        link_url="udpin://127.0.0.1:14550",
        settings={"seed": 3.0},
    )


def status(**changes: object) -> Status:
    """A status as a flight process without a link sends it."""
    nan = float("nan")
    plain = Status(
        t_s=nan, utc_s=1.0, vehicle_name="test quad", vehicle_type="quadrotor", autopilot="px4", system_id=1,
        authority="actuator", link_url="udpin://127.0.0.1:14550", link_state="none", link_silence_s=nan,
        signing="unsigned", state="DISCONNECTED", vehicle_mode="", armed=False, landed="", failsafe="", estimator="",
        position_source="", controller="lqr", gain_set=1, gain_history=(), last_good=0, controls_holder="",
        controls_client="", battery_v=nan, battery_remaining=nan, flight_time_s=0.0,
        trajectory=TrajectoryStatus("hover", None, None, None), origin_latitude_deg=nan, origin_longitude_deg=nan,
        ticks=0, dropped_frames=0, tick_p99_us=nan,
    )  # fmt: skip
    return msgspec.structs.replace(plain, **changes)


class ImitatedFlight:
    """The flight process's ends of the two datagram sockets."""

    def __init__(self, runtime: Runtime) -> None:
        self._hub = str(runtime.flight_socket)
        self._out = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._out.settimeout(5.0)
        self._requests = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        runtime.command_socket.unlink(missing_ok=True)
        self._requests.bind(str(runtime.command_socket))
        self._requests.settimeout(5.0)

    def send(self, message: FlightMessage) -> None:
        """Send to the hub, waiting while its queue is full."""
        self._out.sendto(msgspec.msgpack.encode(message), self._hub)

    def next_request(self) -> Request:
        return msgspec.msgpack.decode(self._requests.recv(1 << 16), type=Request)

    def answer_with(self, sequence: int, answer: Answer, *events: Event) -> None:
        self.send(tick_frame(sequence, answers=(answer,), events=events))

    def close(self) -> None:
        self._out.close()
        self._requests.close()


@contextmanager
def runtime_folder() -> Iterator[Runtime]:
    """A runtime folder with a path short enough for sockets."""
    with tempfile.TemporaryDirectory(prefix="rl") as folder:
        yield open_runtime(Path(folder))


def start_process(module: str, *arguments: str) -> subprocess.Popen[str]:
    """Start a process of the station and wait for its first line of output."""
    process = subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line, f"{module} ended with {process.wait(5)} before it was ready"
    return process


def stop_process(process: subprocess.Popen[str], *, how: signal.Signals = signal.SIGTERM) -> int:
    """Signal a process and wait for its end; returns its exit status."""
    process.send_signal(how)
    code = process.wait(20)
    if process.stdout is not None:
        process.stdout.close()
    return code


@contextmanager
def running(module: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process of the station, ended with the block."""
    process = start_process(module, *arguments)
    try:
        yield process
    finally:
        if process.poll() is None:
            stop_process(process)


def wait_until(condition: object, timeout_s: float = 10.0) -> None:
    """Wait for a condition on the state of another process; fails the test when it does not come."""
    assert callable(condition)
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "condition did not come true"
        time.sleep(0.02)
