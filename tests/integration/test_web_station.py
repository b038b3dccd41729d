"""What the pages get from the station and give to it: REST, stream and scene over real sockets and a real bus."""

from __future__ import annotations

import contextlib
import json
import re
import time
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import numpy as np
import pytest
import viser
import zstandard
from websockets.sync.client import ClientConnection

from gcs.bus import Backlog
from gcs.commands import ApplyGains, Hold
from gcs.records import RecordingStatus
from gcs.signals import FRAME_SIZE
from models.arrays import Array
from tests.integration.web_rig import Browser, Rig, event, frame, status

VISER = f"viser-v{viser.__version__}"
PATIENCE_S = 20.0
ASK_AGAIN_S = 0.5


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    rig = Rig(tmp_path_factory.mktemp("web"))
    past = b"".join(frame(0.1 * k).tobytes() for k in range(50))
    rig.hub.backlog = Backlog(past, (event("before the page opened"),), status(4.9), RecordingStatus("recording", "r1"))
    with rig:
        yield rig


@pytest.fixture(scope="module")
def operator(rig: Rig) -> Iterator[Browser]:
    with rig.server.operator() as browser:
        yield browser


def until(stream: ClientConnection, wanted: Callable[[dict[str, Any] | Array], bool]) -> dict[str, Any] | Array:
    """The first message that is wanted: JSON as a dict, signals as an array of frames."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        raw = stream.recv(timeout=deadline - time.monotonic())
        message = json.loads(raw) if isinstance(raw, str) else np.frombuffer(raw).reshape(-1, FRAME_SIZE)
        if wanted(message):
            return message


def of_type(kind: str) -> Callable[[dict[str, Any] | Array], bool]:
    return lambda message: isinstance(message, dict) and message["type"] == kind


def frames(message: dict[str, Any] | Array) -> bool:
    return isinstance(message, np.ndarray)


def test_stream_opens_with_the_past_and_goes_on_with_the_present(rig: Rig, operator: Browser) -> None:
    with operator.socket("/ws/stream") as stream:
        hello = until(stream, lambda _: True)
        assert isinstance(hello, dict)
        assert hello["type"] == "hello"
        assert hello["frame_size"] == FRAME_SIZE
        assert hello["signals"][0]["name"] == "time"
        assert hello["events"][0]["text"] == "before the page opened"
        assert hello["status"]["vehicle_name"] == "rig"
        assert hello["status"]["battery_v"] is None
        assert hello["status"]["recording"] == "r1"
        past = until(stream, frames)
        assert isinstance(past, np.ndarray)
        assert past[:50, 0].tolist() == pytest.approx([0.1 * k for k in range(50)])
        rig.hub.bus.publish_signals(frame(10.0).tobytes() + frame(10.1, north_m=7.0).tobytes())
        present = until(stream, lambda message: frames(message) and message[-1][0] == 10.1)
        assert isinstance(present, np.ndarray)
        assert np.array_equal(present[-1], frame(10.1, north_m=7.0), equal_nan=True)
        rig.hub.bus.publish_status(status(10.1))
        told = until(stream, of_type("status"))
        assert isinstance(told, dict)
        assert told["t_s"] == 10.1
        rig.hub.bus.publish_event(event("now"))
        happened = until(stream, of_type("event"))
        assert isinstance(happened, dict)
        assert (happened["text"], happened["level"]) == ("now", "advisory")
    assert operator.http.get("/api/status").json()["t_s"] == 10.1
    assert [e["text"] for e in operator.http.get("/api/events", params={"limit": 1}).json()] == ["now"]
    assert operator.http.get("/api/events", params={"limit": 0}).status_code == 422


def test_a_page_that_does_not_read_holds_up_nobody_and_gets_the_newest(rig: Rig, operator: Browser) -> None:
    batch, batches = 100, 300
    with operator.socket("/ws/stream", max_queue=1) as slow, operator.socket("/ws/stream") as quick:
        until(slow, of_type("hello"))
        until(quick, of_type("hello"))
        for number in range(batches):
            start = 1000.0 + number * batch
            rig.hub.bus.publish_signals(b"".join(frame(start + k).tobytes() for k in range(batch)))
            until(quick, lambda m, last=start + batch - 1: frames(m) and m[-1][0] >= last)  # type: ignore[misc]
        last = 1000.0 + batch * batches - 1
        received: list[float] = []
        while not received or received[-1] < last:
            message = until(slow, frames)
            assert isinstance(message, np.ndarray)
            received += message[:, 0].tolist()
        late = [t for t in received if t >= 1000.0]
        assert late == sorted(late)
        assert len(late) < batch * batches


def test_malformed_bus_traffic_reaches_no_page_and_breaks_nothing(rig: Rig, operator: Browser) -> None:
    with operator.socket("/ws/stream") as stream:
        until(stream, of_type("hello"))
        rig.hub.bus.publish_signals(b"\x00" * 13)
        rig.hub.bus._session.put("rotorlab/station/status", b"{")
        rig.hub.bus._session.put("rotorlab/station/event", b"[]")
        rig.hub.bus.publish_signals(frame(5e5).tobytes())
        until(stream, lambda message: frames(message) and message[-1][0] == 5e5)


def test_commands_go_out_with_the_identity_and_answers_come_back(rig: Rig, operator: Browser) -> None:
    own = operator.http.get("/api/session").json()
    assert operator.post("/api/commands", {"type": "hold"}).json() == {"accepted": True, "reason": ""}
    request = rig.hub.requests[-1]
    assert isinstance(request.command, Hold)
    assert (request.identity.name, request.identity.role) == (own["name"], "operator")
    assert request.identity.client == own["client"]
    rig.hub.verdict = lambda _: (False, "Take controls first.")
    change = {"type": "apply_gains", "changes": {"yaw.p": 7.5}, "why": "less overshoot"}
    assert operator.post("/api/commands", change).json() == {"accepted": False, "reason": "Take controls first."}
    rig.hub.verdict = lambda _: (True, "")
    command = rig.hub.requests[-1].command
    assert isinstance(command, ApplyGains)
    assert command.changes == {"yaw.p": 7.5}
    assert rig.hub.requests[-1].number != rig.hub.requests[-2].number


def test_bad_commands_are_refused_in_words_and_sent_to_nobody(rig: Rig, operator: Browser) -> None:
    before = len(rig.hub.requests)
    for body, words in (
        ({"type": "take_off", "height_m": 500}, "height_m: Expected float <= 100.0"),
        ({"type": "take_of"}, "Invalid value 'take_of'; one of take_controls"),
        ({"type": "apply_gains", "changes": {"yaw.p": 1}, "why": ""}, "why: "),
        (["hold"], "Expected object, got array"),
    ):
        answer = operator.post("/api/commands", body)
        assert answer.status_code == 422
        assert words in answer.json()["detail"]
    assert len(rig.hub.requests) == before


def test_design_answers_at_once_and_names_a_bad_gain(operator: Browser) -> None:
    body = {"controller": "lqr", "changes": {"attitude.q_roll": 40.0}}
    answer = operator.post("/api/design", body)
    assert answer.status_code == 200
    report = answer.json()
    assert report["live"]["stable"] and report["staged"]["stable"]
    assert report["live"]["poles"] != report["staged"]["poles"]
    assert {loop["name"] for loop in report["staged"]["loops"]} >= {"roll", "pitch", "yaw", "height"}
    bad = operator.post("/api/design", {"controller": "lqr", "changes": {"attitude.q_roll": -1.0}})
    assert bad.status_code == 422
    assert "attitude.q_roll = -1" in bad.json()["detail"] and "outside 0 to" in bad.json()["detail"]


def test_tables_and_interface_description(operator: Browser) -> None:
    assert operator.http.get("/api/signals").json()[-1]["offset"] + 1 == FRAME_SIZE
    assert {kind["kind"] for kind in operator.http.get("/api/trajectories").json()} >= {"hover", "go_to", "circle"}
    assert set(operator.http.get("/api/gains").json()["controllers"]) == {"lqr", "pid"}
    assert operator.http.get("/api/runs").json() == []
    described = operator.http.get("/api/openapi.json").json()
    body = described["paths"]["/api/commands"]["post"]["requestBody"]["content"]["application/json"]["schema"]
    assert {"$ref": "#/components/schemas/FlyTrajectory"} in body["anyOf"]
    assert "FlyTrajectory" in described["components"]["schemas"]
    page = operator.http.get("/api/docs").text
    assert "POST /api/commands" in page and "height_m" in page and "<script" not in page


def test_scene_page_is_visers_with_our_bridge_under_its_own_policy(operator: Browser) -> None:
    page = operator.http.get("/scene/")
    host = operator.base.removeprefix("http://")
    policy = page.headers["content-security-policy"]
    match = re.search(r"'nonce-([\w-]+)'", policy)
    assert match is not None
    assert policy == (
        f"default-src 'none'; script-src 'nonce-{match[1]}' 'strict-dynamic' 'wasm-unsafe-eval'; "
        "style-src 'self' 'unsafe-inline'; font-src data:; img-src data: blob:; "
        f"connect-src ws://{host}/scene wss://{host}/scene data: blob:; worker-src blob: data:; "
        "form-action 'none'; base-uri 'none'; frame-ancestors 'self'"
    )
    assert page.headers["x-frame-options"] == "SAMEORIGIN"
    scripts = re.findall(r"<script[\s>][^>]{0,60}", page.text)
    assert len(scripts) >= 2
    assert all(script.startswith(f'<script nonce="{match[1]}"') for script in scripts)
    assert page.text.index("/scene/bridge.js") < page.text.index("data-p=")
    assert "postMessage" in operator.http.get("/scene/bridge.js").text
    assert operator.http.get("/scene/scene.css").headers["content-type"].startswith("text/css")
    assert operator.http.get("/scene/scene.py").status_code == 404
    assert operator.http.get("/scene/").headers["content-security-policy"] != policy


def viser_messages(raw: str | bytes) -> list[dict[str, Any]]:
    """Messages of one packet of viser's stream: two lengths, then zstd-compressed msgpack."""
    assert isinstance(raw, bytes)
    size, compressed = (int.from_bytes(raw[k : k + 8], "little") for k in (0, 8))
    packed = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + compressed], max_output_size=size)
    messages: list[dict[str, Any]] = msgspec.msgpack.decode(packed)["messages"]
    return messages


def camera_moves(messages: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Camera positions that were asked for, without the one every page starts with."""
    return [m for m in messages if m["type"] == "SetCameraPositionMessage" and not m["initial"]]


def seen(stream: ClientConnection, kind: str) -> dict[str, Any]:
    deadline = time.monotonic() + PATIENCE_S
    while True:
        for message in viser_messages(stream.recv(timeout=deadline - time.monotonic())):
            if message["type"] == kind or kind in str(message.get("name")):
                return message


CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [3.0, 3.0, 3.0],
    "fov": 0.7,
    "near": 0.1,
    "far": 1000.0,
    "image_height": 400,
    "image_width": 800,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


def test_scene_draws_the_vehicle_and_each_session_has_its_own_camera(rig: Rig, operator: Browser) -> None:
    with rig.server.operator() as other, other.socket("/scene", subprotocols=[VISER]) as others_scene:
        with operator.socket("/scene", subprotocols=[VISER]) as scene:
            assert scene.subprotocol == VISER
            seen(scene, "/vehicle/arms")
            for stream in (scene, others_scene):
                stream.send(msgspec.msgpack.encode(CAMERA))
            above: dict[str, Any] | None = None
            time_s = 1e6
            while above is None:
                # The camera is known to viser a moment after it was sent; ask until it has moved.
                assert operator.post("/api/scene/camera", {"view": "top"}).json() == {"view": "top"}
                time_s += 1.0
                rig.hub.bus.publish_signals(frame(time_s, north_m=6.0).tobytes())
                messages = viser_messages(scene.recv(timeout=PATIENCE_S))
                targets = [m for m in messages if m["type"] == "SetCameraLookAtMessage"]
                for move, target in zip(camera_moves(messages), targets, strict=False):
                    aside_m = np.hypot(*np.subtract(move["position"], target["look_at"])[:2])
                    above = move if aside_m < 0.1 * move["position"][2] else above
            # The other drags its own picture; what was under way to it before that is not what this one asked for.
            assert other.post("/api/scene/camera", {"view": "own"}).json() == {"view": "own"}
            assert above["position"][2] > 3.0
        rig.hub.bus.publish_signals(frame(2e6, north_m=9.0).tobytes())
        while True:
            messages = viser_messages(others_scene.recv(timeout=PATIENCE_S))
            assert not any(move["position"] == above["position"] for move in camera_moves(messages))
            vehicle = [m for m in messages if m["type"] == "SetPositionMessage" and m["name"] == "/vehicle"]
            if vehicle and vehicle[-1]["position"] == pytest.approx([2.0, 9.0, 3.0]):
                break
    assert operator.post("/api/scene/camera", {"view": "behind"}).status_code == 422


def test_only_camera_messages_reach_viser(operator: Browser) -> None:
    with operator.socket("/scene", subprotocols=[VISER]) as scene:
        for raw in (
            msgspec.msgpack.encode({"type": "ShareUrlRequest"}),
            msgspec.msgpack.encode({"type": "SomethingElse"}),
            b"\xff\x00",
            b"",
        ):
            scene.send(raw)
        scene.send("text")
        # Any of them would have ended viser's side of the connection with an error, or asked a host outside for a link.
        scene.send(msgspec.msgpack.encode(CAMERA))
        seen(scene, "/vehicle/arms")
        scene.ping().wait(PATIENCE_S)
        # The camera is known to viser a moment after it was sent; ask until it has moved.
        for _ in range(round(PATIENCE_S / ASK_AGAIN_S)):
            assert operator.post("/api/scene/camera", {"view": "north"}).status_code == 200
            with contextlib.suppress(TimeoutError):
                if camera_moves(viser_messages(scene.recv(timeout=ASK_AGAIN_S))):
                    return
        raise AssertionError("viser never moved the camera")


def test_without_a_hub_commands_are_refused_and_not_kept(tmp_path_factory: pytest.TempPathFactory) -> None:
    with Rig(tmp_path_factory.mktemp("alone")) as rig, rig.server.operator() as browser:
        rig.hub.bus.close()
        answer = browser.post("/api/commands", {"type": "hold"})
        assert answer.status_code == 200
        assert answer.json()["accepted"] is False
        assert "hub does not answer" in answer.json()["reason"]
        assert browser.http.get("/api/status").status_code == 503


def test_a_restarted_hub_is_found_again(tmp_path_factory: pytest.TempPathFactory) -> None:
    with Rig(tmp_path_factory.mktemp("again")) as rig, rig.server.operator() as browser:
        with browser.socket("/ws/stream") as stream:
            until(stream, of_type("hello"))
            rig.restart_hub()
            time_s, heard = 50.0, False
            deadline = time.monotonic() + PATIENCE_S
            while not heard and time.monotonic() < deadline:
                time_s += 1.0
                rig.hub.bus.publish_signals(frame(time_s).tobytes())
                with contextlib.suppress(TimeoutError):
                    heard = isinstance(stream.recv(timeout=0.2), bytes)
            assert heard
        assert browser.post("/api/commands", {"type": "hold"}).json()["accepted"] is True
