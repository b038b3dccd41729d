"""Link URLs, written as MAVSDK writes them."""

from __future__ import annotations

import re
from dataclasses import dataclass

FORMS = (
    "udpin://[host:]port",
    "udpout://host:port",
    "tcpin://[host:]port",
    "tcpout://host:port",
    "serial://device:baud",
)
LOOPBACK = "127.0.0.1"
MAX_PORT = 65535

_NETWORK = re.compile(r"(?:(?P<host>\[[0-9a-fA-F:.]+\]|[^:/\s]*):)?(?P<port>\d+)/?")
_SERIAL = re.compile(r"(?P<device>[^\s]+):(?P<baud>\d+)")


class LinkUrlError(ValueError):
    """A link URL that cannot be understood; the message names the URL, the fault and the valid forms."""


@dataclass(frozen=True, slots=True)
class LinkUrl:
    """A parsed URL: ``host`` and ``port``, or serial device and baud rate; ``text`` is the URL as written."""

    scheme: str
    host: str
    port: int
    text: str


def parse_link_url(text: str) -> LinkUrl:
    """Take a link URL apart. Raises LinkUrlError naming what is wrong and the valid forms."""
    scheme, separator, rest = text.strip().partition("://")
    if not separator or f"{scheme}://" not in {f"{form.partition('://')[0]}://" for form in FORMS}:
        hint = f"; did you mean {scheme}in:// or {scheme}out://?" if scheme in ("udp", "tcp") else ""
        raise LinkUrlError(_message(text, f"'{scheme}' is not a kind of link{hint}"))
    if scheme == "serial":
        match = _SERIAL.fullmatch(rest)
        if match is None or int(match["baud"]) == 0:
            raise LinkUrlError(
                _message(text, "a serial link needs a device and a baud rate, serial:///dev/ttyACM0:57600")
            )
        return LinkUrl(scheme, match["device"], int(match["baud"]), text)
    match = _NETWORK.fullmatch(rest)
    if match is None:
        raise LinkUrlError(_message(text, f"'{rest}' is not [host:]port"))
    host, port = (match["host"] or "").strip("[]"), int(match["port"])
    listens = scheme.endswith("in")
    if not host and not listens:
        raise LinkUrlError(_message(text, f"{scheme} needs the host to send to"))
    if port > MAX_PORT or (port == 0 and not listens):
        raise LinkUrlError(_message(text, f"port {port} is not in 1..{MAX_PORT}"))
    return LinkUrl(scheme, host or LOOPBACK, port, text)


def _message(text: str, fault: str) -> str:
    return f"link '{text}': {fault}. Valid forms: {', '.join(FORMS)}"
