"""The hub as a real process on real sockets and a real zenoh router; only the flight process is imitated."""

from __future__ import annotations

import queue
import signal
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from gcs import commands as c
from gcs.bus import Bus, BusError, Topic, decode_event, decode_recording, decode_status, open_client
from gcs.commands import Answer, Identity
from gcs.recording import read_run
from gcs.recording_inputs import read_inputs
from gcs.records import ActionRequest, ActionResult, Event, GainRecord
from gcs.runtime import Runtime
from gcs.signals import FRAME_SIZE, SLICES
from tests.station_rig import (
    ImitatedFlight,
    flight_start,
    running,
    runtime_folder,
    start_process,
    status,
    stop_process,
    tick_frame,
    wait_until,
)

ME = Identity("anna", "operator", "cli")


@pytest.fixture
def runtime() -> Iterator[Runtime]:
    with runtime_folder() as folder:
        yield folder


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    return tmp_path / "runs"


@pytest.fixture
def hub(runtime: Runtime, runs: Path) -> Iterator[subprocess.Popen[str]]:
    arguments = ("--runtime", str(runtime.folder), "--runs", str(runs), "--note", "sim.seed=7")
    with running("gcs.hub", *arguments) as process:
        yield process


@pytest.fixture
def flight(runtime: Runtime, hub: subprocess.Popen[str]) -> Iterator[ImitatedFlight]:
    imitated = ImitatedFlight(runtime)
    yield imitated
    imitated.close()


@pytest.fixture
def bus(runtime: Runtime, hub: subprocess.Popen[str]) -> Iterator[Bus]:
    with open_client(runtime.zenoh_socket) as client:
        yield client


def listen(bus: Bus, topic: Topic) -> queue.Queue[bytes]:
    heard: queue.Queue[bytes] = queue.Queue()
    bus.subscribe(topic, heard.put)
    bus.backlog()  # a round trip: the hub knows of the subscription now
    return heard


def test_signals_status_and_events_reach_a_client(bus: Bus, flight: ImitatedFlight) -> None:
    signals, states, events = (listen(bus, topic) for topic in (Topic.SIGNALS, Topic.STATUS, Topic.EVENT))
    caution = Event(10.0, "caution", "Battery 13.9 V, limit 14.0 V. Land.", "flight")
    flight.send(tick_frame(0, events=(caution,)))
    flight.send(status(armed=True))

    frame = np.frombuffer(signals.get(timeout=5))
    assert frame.shape == (FRAME_SIZE,)
    assert frame[SLICES["estimate.position_ned"]].tolist() == [0.0, 2.0, -3.0]
    assert decode_event(events.get(timeout=5)) == caution
    received = decode_status(states.get(timeout=5))
    assert received.armed and received.vehicle_name == "test quad" and np.isnan(received.battery_v)


def test_status_is_sent_again_without_a_new_one(bus: Bus, flight: ImitatedFlight) -> None:
    states = listen(bus, Topic.STATUS)
    flight.send(status())
    for _ in range(3):
        states.get(timeout=2)


def test_a_page_that_opens_late_gets_the_past(bus: Bus, flight: ImitatedFlight) -> None:
    signals = listen(bus, Topic.SIGNALS)
    advisory = Event(10.0, "advisory", "Roll gains set 2 applied by anna.", "flight")
    for sequence in range(6):
        flight.send(tick_frame(sequence, events=(advisory,)))
        signals.get(timeout=5)
    flight.send(status())
    wait_until(lambda: bus.backlog().status is not None)
    backlog = bus.backlog()
    frames = np.frombuffer(backlog.frames).reshape(-1, FRAME_SIZE)
    assert len(frames) >= 2
    assert np.all(np.diff(frames[:, 0]) > 0.0)
    assert backlog.events.count(advisory) == 6


def test_a_reboot_of_the_vehicle_clock_empties_the_past(bus: Bus, flight: ImitatedFlight) -> None:
    signals = listen(bus, Topic.SIGNALS)
    for sequence in (*range(1000, 1004), *range(4)):
        flight.send(tick_frame(sequence))
        signals.get(timeout=5)
    frames = np.frombuffer(bus.backlog().frames).reshape(-1, FRAME_SIZE)
    assert frames[:, 0].max() < 11.0


def test_signals_are_thinned_and_the_recording_is_not(
    bus: Bus, flight: ImitatedFlight, hub: subprocess.Popen[str], runs: Path
) -> None:
    signals = listen(bus, Topic.SIGNALS)
    for sequence in range(2000):
        flight.send(tick_frame(sequence))
    wait_until(lambda: any(np.frombuffer(frame)[1 - 1] > 29.98 for frame in list(signals.queue)))
    assert signals.qsize() < 1000
    assert stop_process(hub) == 0
    (folder,) = runs.iterdir()
    assert [record.sequence for record in read_inputs(folder / "inputs.mpk")] == list(range(2000))


def test_a_command_is_answered_by_the_flight_process(bus: Bus, flight: ImitatedFlight) -> None:
    answers: queue.Queue[Answer] = queue.Queue()
    command = c.ApplyGains({"roll.k_p": 3.0}, "test")
    asker = threading.Thread(target=lambda: answers.put(bus.request(c.Request(41, ME, command, 5.0))))
    asker.start()
    request = flight.next_request()
    assert (request.identity, request.command, request.utc_s) == (ME, command, 5.0)
    flight.answer_with(0, Answer(request.number, False, "roll.k_p = 3: at most 2.5"))
    asker.join(5)
    assert answers.get_nowait() == Answer(41, False, "roll.k_p = 3: at most 2.5")


def test_numbers_of_two_askers_do_not_collide(bus: Bus, flight: ImitatedFlight) -> None:
    answers: dict[str, Answer] = {}

    def ask(name: str, command: c.AnyCommand) -> None:
        answers[name] = bus.request(c.Request(1, Identity(name, "operator", name), command, 0.0))

    askers = [threading.Thread(target=ask, args=pair) for pair in (("a", c.Hold()), ("b", c.Land()))]
    for asker in askers:
        asker.start()
    requests = [flight.next_request(), flight.next_request()]
    for sequence, request in enumerate(reversed(requests)):
        flight.answer_with(sequence, Answer(request.number, True, request.identity.name))
    for asker in askers:
        asker.join(5)
    assert {name: answer.reason for name, answer in answers.items()} == {"a": "a", "b": "b"}


def test_a_silent_flight_process_means_refused(bus: Bus, flight: ImitatedFlight) -> None:
    answer = bus.command(c.Hold(), ME)
    assert not answer.accepted
    assert answer.reason == "The flight process does not answer for 1 s."


def test_no_flight_process_means_refused_at_once(bus: Bus, runtime: Runtime) -> None:
    answer = bus.command(c.Hold(), ME, timeout_s=0.9)
    assert not answer.accepted
    assert answer.reason.startswith("The flight process is not running.")


def test_nonsense_on_the_bus_is_refused_with_the_reason(bus: Bus, flight: ImitatedFlight) -> None:
    with pytest.raises(BusError, match=r"not understood: .*missing required field"):
        bus._ask(Topic.COMMAND, b"{}", msgspec.json.decode, 2.0)
    bad = msgspec.json.encode(
        {"number": 1, "identity": ME, "utc_s": 0.0, "command": {"type": "take_off", "height_m": 900}}
    )
    with pytest.raises(BusError, match="<= 100"):
        bus._ask(Topic.COMMAND, bad, msgspec.json.decode, 2.0)


def test_nonsense_from_the_flight_socket_is_an_event_and_the_hub_lives(bus: Bus, flight: ImitatedFlight) -> None:
    events = listen(bus, Topic.EVENT)
    flight._out.sendto(b"\xc1 not msgpack", flight._hub)
    assert "not understood" in decode_event(events.get(timeout=5)).text
    flight.send(status())
    wait_until(lambda: bus.backlog().status is not None)


def test_the_flight_process_may_come_back_and_is_a_new_run(
    bus: Bus, flight: ImitatedFlight, hub: subprocess.Popen[str], runs: Path
) -> None:
    flight.send(flight_start("life-1"))
    for sequence in range(10):
        flight.send(tick_frame(sequence, session="life-1"))
    flight.send(flight_start("life-2"))
    for sequence in range(5):
        flight.send(tick_frame(sequence, session="life-2"))
    assert stop_process(hub) == 0
    infos = sorted((read_run(folder) for folder in runs.iterdir()), key=lambda info: info.session)
    assert [(info.session, info.ticks) for info in infos] == [("life-1", 10), ("life-2", 5)]
    assert infos[0].start == flight_start("life-1")
    assert infos[0].station == {"sim.seed": "7"}


def test_a_killed_hub_loses_at_most_what_was_not_flushed_and_goes_on(runtime: Runtime, runs: Path) -> None:
    arguments = ("--runtime", str(runtime.folder), "--runs", str(runs))
    hub = start_process("gcs.hub", *arguments)
    flight = ImitatedFlight(runtime)
    with open_client(runtime.zenoh_socket) as client:
        recording = listen(client, Topic.RECORDING)
        flight.send(flight_start())
        for sequence in range(300):
            flight.send(tick_frame(sequence))
        while decode_recording(recording.get(timeout=5)).ticks < 300:
            pass
    flight.send(tick_frame(300))
    stop_process(hub, how=signal.SIGKILL)
    (folder,) = runs.iterdir()
    assert len(list(read_inputs(folder / "inputs.mpk"))) >= 300
    # A torn tail, as a crash in the middle of a write leaves it.
    with (folder / "inputs.mpk").open("ab") as stream:
        stream.write(b"\x40\x00\x00\x00torn")

    with running("gcs.hub", *arguments) as again:
        for sequence in range(305, 400):
            flight.send(tick_frame(sequence))
        assert stop_process(again) == 0
    flight.close()
    assert list(runs.iterdir()) == [folder]
    info = read_run(folder)
    sequences = [record.sequence for record in read_inputs(folder / "inputs.mpk")]
    assert sequences[-1] == 399 and sequences == sorted(set(sequences))
    assert info.ticks == len(sequences)
    assert info.missing_ticks == 400 - len(sequences)
    assert info.start == flight_start() and info.ended_utc
    assert {"signals.mcap", "signals-2.mcap", "inputs.mpk", "flight.tlog"} <= set(info.sha256)


def test_the_gain_history_is_in_the_run(flight: ImitatedFlight, hub: subprocess.Popen[str], runs: Path) -> None:
    row = GainRecord(2, 5.0, "anna", "less overshoot", "lqr", "default", {"q": 1.0}, {"q": (2.0, 1.0)})
    flight.send(tick_frame(0))
    flight.send(status(gain_history=(row,)))
    assert stop_process(hub) == 0
    (folder,) = runs.iterdir()
    assert read_run(folder).gain_history == (row,)


def test_the_outcome_of_an_action_becomes_an_event(bus: Bus, flight: ImitatedFlight, runtime: Runtime) -> None:
    events = listen(bus, Topic.EVENT)
    with open_client(runtime.zenoh_socket) as actions:
        actions.serve_actions(
            lambda action, reply: reply(ActionResult(action.number, False, "Arm refused: no GNSS fix."))
        )
        actions.backlog()
        flight.send(tick_frame(0, actions=(ActionRequest(9, "arm", "anna"),)))
        event = decode_event(events.get(timeout=5))
    assert (event.level, event.text, event.source, event.who) == (
        "caution",
        "Arm refused: no GNSS fix.",
        "actions",
        "anna",
    )


def test_without_an_actions_process_the_event_says_so(bus: Bus, flight: ImitatedFlight) -> None:
    events = listen(bus, Topic.EVENT)
    flight.send(tick_frame(0, actions=(ActionRequest(9, "take_off", "anna", 2.5),)))
    assert decode_event(events.get(timeout=5)).text == "Take off refused: the actions process does not answer."


def test_a_report_of_another_process_is_published_and_kept(bus: Bus, flight: ImitatedFlight) -> None:
    events = listen(bus, Topic.EVENT)
    report = Event(float("nan"), "caution", "Web process ended, restarted.", "gcs up")
    bus.report(report)
    assert decode_event(events.get(timeout=5)).text == report.text
    assert any(event.text == report.text for event in bus.backlog().events)
