"""Where packets come from and go to, by URL: UDP, TCP and serial."""

from __future__ import annotations

from gcs.mavlink.endpoint import Endpoint, LinkOpenError
from gcs.mavlink.serial_port import SerialEndpoint
from gcs.mavlink.tcp import TcpEndpoint
from gcs.mavlink.udp import UdpEndpoint
from gcs.mavlink.urls import LinkUrlError, parse_link_url

__all__ = [
    "Endpoint",
    "LinkOpenError",
    "LinkUrlError",
    "SerialEndpoint",
    "TcpEndpoint",
    "UdpEndpoint",
    "open_endpoint",
    "parse_link_url",
]


def open_endpoint(url: str) -> Endpoint:
    """Open a link by URL: ``udpin://[host:]port``, ``udpout://``, ``tcpin://``, ``tcpout://``, ``serial://dev:baud``.

    A TCP connection that is refused is not an error: it is tried again for as long as the endpoint is polled.
    Raises LinkUrlError for a URL that is none of these, LinkOpenError where a port is taken or a device is missing.
    """
    parsed = parse_link_url(url)
    if parsed.scheme in ("udpin", "udpout"):
        return UdpEndpoint(parsed)
    if parsed.scheme in ("tcpin", "tcpout"):
        return TcpEndpoint(parsed)
    return SerialEndpoint(parsed)
