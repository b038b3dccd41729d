"""Endpoints on real sockets and a real pseudo-terminal."""

from __future__ import annotations

import os
import pty
import select
import socket
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import pytest

from gcs.mavlink.encoder import Encoder
from gcs.mavlink.endpoints import (
    Endpoint,
    LinkOpenError,
    LinkUrlError,
    SerialEndpoint,
    TcpEndpoint,
    UdpEndpoint,
    open_endpoint,
    parse_link_url,
)

PATIENCE_S = 10.0
HEARTBEAT = Encoder(1, 1).heartbeat()


def wait_for(endpoint: Endpoint, wanted: int) -> list[bytes]:
    """Packets once at least ``wanted`` bytes came in; waits on the descriptor, as the flight process does."""
    packets: list[bytes] = []
    deadline = time.monotonic() + PATIENCE_S
    while sum(map(len, packets)) < wanted:
        remaining = deadline - time.monotonic()
        assert remaining > 0, f"only {packets} arrived"
        if endpoint.fileno() >= 0:
            select.select([endpoint.fileno()], [], [], remaining)
        packets += endpoint.receive()
    return packets


def poll_until(endpoint: Endpoint, condition: Callable[[], bool], step_s: float = 0.1) -> float:
    """Poll on a clock of our own, as fast as it goes, until the condition holds; returns that clock."""
    deadline = time.monotonic() + PATIENCE_S
    now_s = 0.0
    while not condition():
        assert time.monotonic() < deadline
        endpoint.poll(now_s)
        now_s += step_s
        select.select([], [], [], 0.001)
    return now_s


@pytest.fixture
def peer() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(PATIENCE_S)
        yield sock


def test_udpin_locks_to_the_first_peer_that_speaks_mavlink(peer: socket.socket) -> None:
    endpoint = open_endpoint("udpin://0")
    assert isinstance(endpoint, UdpEndpoint)
    with closing(endpoint), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.1", 0))
        address = ("127.0.0.1", endpoint.port)
        assert not endpoint.connected
        assert not endpoint.send(b"nobody there")
        assert endpoint.dropped == 1
        stranger.sendto(b"GET / HTTP/1.1", address)
        peer.sendto(HEARTBEAT, address)
        assert wait_for(endpoint, len(HEARTBEAT)) == [HEARTBEAT]
        assert endpoint.connected
        stranger.sendto(HEARTBEAT, address)
        peer.sendto(HEARTBEAT + b"2", address)
        assert wait_for(endpoint, len(HEARTBEAT) + 1) == [HEARTBEAT + b"2"]
        assert endpoint.foreign == 2
        assert endpoint.send(b"answer")
        assert peer.recv(100) == b"answer"


def test_udpin_gives_a_silent_peer_up_after_five_seconds_of_the_callers_clock(peer: socket.socket) -> None:
    endpoint = open_endpoint("udpin://127.0.0.1:0")
    assert isinstance(endpoint, UdpEndpoint)
    with closing(endpoint), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as restarted:
        restarted.bind(("127.0.0.1", 0))
        address = ("127.0.0.1", endpoint.port)
        peer.sendto(HEARTBEAT, address)
        wait_for(endpoint, len(HEARTBEAT))
        endpoint.poll(100.0)
        endpoint.poll(104.9)
        assert endpoint.connected
        endpoint.poll(105.2)
        assert not endpoint.connected
        restarted.sendto(HEARTBEAT, address)
        assert wait_for(endpoint, len(HEARTBEAT)) == [HEARTBEAT]
        assert endpoint.connected


def test_udpin_binds_loopback_unless_told_otherwise() -> None:
    assert parse_link_url("udpin://14540").host == "127.0.0.1"
    assert parse_link_url("udpin://:14540").host == "127.0.0.1"
    assert parse_link_url("udpin://0.0.0.0:14540").host == "0.0.0.0"
    assert parse_link_url("tcpin://5760").host == "127.0.0.1"


def test_udpout_speaks_first_survives_nobody_and_hears_only_its_peer(peer: socket.socket) -> None:
    host, port = peer.getsockname()
    with closing(open_endpoint(f"udpout://{host}:{port}")) as endpoint:
        assert endpoint.connected
        assert endpoint.send(HEARTBEAT)
        data, address = peer.recvfrom(100)
        assert data == HEARTBEAT
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(b"not from the peer", address)
        peer.sendto(b"reply", address)
        assert wait_for(endpoint, 5) == [b"reply"]
        peer.close()
        for _ in range(5):
            endpoint.send(HEARTBEAT)
            assert endpoint.receive() == []


def test_one_drain_gives_everything_that_waits(peer: socket.socket) -> None:
    endpoint = open_endpoint("udpin://0")
    assert isinstance(endpoint, UdpEndpoint)
    with closing(endpoint):
        for _ in range(40):
            peer.sendto(HEARTBEAT, ("127.0.0.1", endpoint.port))
        assert wait_for(endpoint, 40 * len(HEARTBEAT)) == [HEARTBEAT] * 40
        assert endpoint.receive() == []


def test_port_in_use_says_what_to_do() -> None:
    endpoint = open_endpoint("udpin://0")
    assert isinstance(endpoint, UdpEndpoint)
    with closing(endpoint), pytest.raises(LinkOpenError, match=rf"port {endpoint.port} is in use.*another port"):
        open_endpoint(f"udpin://{endpoint.port}")


def test_address_of_another_machine_cannot_be_bound() -> None:
    with pytest.raises(LinkOpenError, match="not an address of this machine"):
        open_endpoint("udpin://192.0.2.1:14550")


def test_tcpout_connects_when_the_vehicle_comes_and_again_when_it_returns() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with closing(open_endpoint(f"tcpout://127.0.0.1:{port}")) as endpoint:
        for tick in range(20):
            endpoint.poll(0.1 * tick)
        assert not endpoint.connected
        assert not endpoint.send(HEARTBEAT)
        for round_number in range(2):
            with socket.create_server(("127.0.0.1", port)) as server:
                server.settimeout(PATIENCE_S)
                poll_until(endpoint, lambda: endpoint.connected)
                generation = endpoint.generation
                connection, _ = server.accept()
                with connection:
                    connection.settimeout(PATIENCE_S)
                    assert endpoint.send(HEARTBEAT)
                    assert connection.recv(100) == HEARTBEAT
                    connection.sendall(b"round" + bytes((round_number,)))
                    assert b"".join(wait_for(endpoint, 6)) == b"round" + bytes((round_number,))
            select.select([endpoint.fileno()], [], [], PATIENCE_S)
            assert endpoint.receive() == []
            assert not endpoint.connected
            assert endpoint.generation > generation


def test_tcpout_backs_off_on_the_callers_clock() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    endpoint = open_endpoint(f"tcpout://127.0.0.1:{port}")
    assert isinstance(endpoint, TcpEndpoint)
    with closing(endpoint):
        attempts = []
        for tick in range(600):
            before = endpoint.generation
            endpoint.poll(0.05 * tick)
            if endpoint.generation > before and not endpoint.connected:
                attempts.append(0.05 * tick)
        gaps = [later - sooner for sooner, later in pairwise(attempts)]
        assert len(attempts) <= 12
        assert max(gaps) >= 4.0


def test_tcpin_serves_one_peer_and_then_the_next() -> None:
    endpoint = open_endpoint("tcpin://0")
    assert isinstance(endpoint, TcpEndpoint)
    with closing(endpoint):
        for _ in range(2):
            with socket.create_connection(("127.0.0.1", endpoint.port), PATIENCE_S) as vehicle:
                vehicle.sendall(HEARTBEAT)
                assert b"".join(wait_for(endpoint, len(HEARTBEAT))) == HEARTBEAT
                assert endpoint.connected
                assert endpoint.send(b"answer")
                assert vehicle.recv(100) == b"answer"
            select.select([endpoint.fileno()], [], [], PATIENCE_S)
            assert endpoint.receive() == []
            assert not endpoint.connected


def test_full_tcp_socket_drops_whole_packets_and_counts_them() -> None:
    endpoint = open_endpoint("tcpin://0")
    assert isinstance(endpoint, TcpEndpoint)
    packet = bytes(range(250))
    with closing(endpoint), socket.create_connection(("127.0.0.1", endpoint.port), PATIENCE_S) as vehicle:
        vehicle.sendall(HEARTBEAT)
        wait_for(endpoint, len(HEARTBEAT))
        sent = 0
        while endpoint.dropped < 100:
            sent += endpoint.send(packet)
            assert sent < 200_000, "the socket never filled"
        vehicle.settimeout(PATIENCE_S)
        received = b""
        while len(received) < sent * len(packet):
            received += vehicle.recv(1 << 20)
            endpoint.poll(0.0)
        assert received == packet * sent


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for descriptor in (master, slave):
        os.close(descriptor)


def test_serial_port_both_ways(terminal: tuple[int, str]) -> None:
    master, device = terminal
    endpoint = open_endpoint(f"serial://{device}:57600")
    assert isinstance(endpoint, SerialEndpoint)
    with closing(endpoint):
        os.write(master, HEARTBEAT)
        assert b"".join(wait_for(endpoint, len(HEARTBEAT))) == HEARTBEAT
        assert endpoint.receive() == []
        assert endpoint.send(b"answer")
        assert os.read(master, 100) == b"answer"


def test_serial_port_that_goes_away_is_opened_again(tmp_path: Path) -> None:
    link = tmp_path / "ttyVehicle"
    master, slave = pty.openpty()
    tty.setraw(slave)
    link.symlink_to(os.ttyname(slave))
    with closing(open_endpoint(f"serial://{link}:115200")) as endpoint:
        os.close(slave)
        os.close(master)
        link.unlink()
        select.select([endpoint.fileno()], [], [], PATIENCE_S)
        endpoint.receive()
        assert not endpoint.connected
        assert endpoint.fileno() == -1
        assert not endpoint.send(HEARTBEAT)
        for tick in range(50):
            endpoint.poll(0.1 * tick)
        assert not endpoint.connected
        master, slave = pty.openpty()
        tty.setraw(slave)
        link.symlink_to(os.ttyname(slave))
        poll_until(endpoint, lambda: endpoint.connected)
        os.write(master, HEARTBEAT)
        assert b"".join(wait_for(endpoint, len(HEARTBEAT))) == HEARTBEAT
        os.close(slave)
        os.close(master)


def test_missing_serial_device_is_named() -> None:
    with pytest.raises(LinkOpenError, match="no device '/dev/ttyNowhere'"):
        open_endpoint("serial:///dev/ttyNowhere:57600")


def test_urls_as_mavsdk_writes_them() -> None:
    parsed = parse_link_url("serial:///dev/ttyACM0:921600")
    assert (parsed.scheme, parsed.host, parsed.port) == ("serial", "/dev/ttyACM0", 921600)
    assert parse_link_url("serial://COM3:57600").host == "COM3"
    assert parse_link_url("udpout://[::1]:14550").host == "::1"
    assert parse_link_url("tcpout://vehicle.local:5760").port == 5760


@pytest.mark.parametrize(
    ("url", "fault"),
    [
        ("udp://:14540", "did you mean udpin:// or udpout://"),
        ("http://localhost:80", "'http' is not a kind of link"),
        ("14540", "not a kind of link"),
        ("udpin://", "not .host:.port"),
        ("udpin://host:port", "not .host:.port"),
        ("udpout://14550", "needs the host"),
        ("udpin://127.0.0.1:70000", "port 70000 is not in"),
        ("tcpout://127.0.0.1:0", "port 0 is not in"),
        ("serial:///dev/ttyACM0", "needs a device and a baud rate"),
        ("serial:///dev/ttyACM0:fast", "needs a device and a baud rate"),
    ],
)
def test_wrong_urls_name_the_fault_and_the_valid_forms(url: str, fault: str) -> None:
    with pytest.raises(LinkUrlError, match=fault) as caught:
        open_endpoint(url)
    assert f"'{url}'" in str(caught.value)
    assert "udpin://[host:]port" in str(caught.value)


def test_unknown_host_is_named() -> None:
    with pytest.raises(LinkOpenError, match=r"host 'no-such-host\.invalid' is not known"):
        open_endpoint("udpout://no-such-host.invalid:14550")
