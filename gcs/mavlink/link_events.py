"""What happens on a link, as data: the flight process words it for the operator."""

from __future__ import annotations

import msgspec


class LinkEvent(msgspec.Struct, frozen=True, tag_field="kind", kw_only=True):
    """Base of link events; ``time_s`` is on the vehicle clock."""

    time_s: float


class VehicleFound(LinkEvent, frozen=True, tag="vehicle_found", kw_only=True):
    """The link has locked to the first vehicle it heard."""

    system: int
    component: int
    autopilot: int
    vehicle_type: int


class VehicleLost(LinkEvent, frozen=True, tag="vehicle_lost", kw_only=True):
    """No heartbeat for ``age_s``; the lock stays, as the vehicle may come back."""

    age_s: float


class VehicleReturned(LinkEvent, frozen=True, tag="vehicle_returned", kw_only=True):
    """The first heartbeat after a loss."""


class VehicleRebooted(LinkEvent, frozen=True, tag="vehicle_rebooted", kw_only=True):
    """The vehicle's stamps jumped back from ``before_s`` to ``time_s``: estimators must begin anew."""

    before_s: float


class AutopilotChanged(LinkEvent, frozen=True, tag="autopilot_changed", kw_only=True):
    """The vehicle now says it is something else (a simulator restarted as another type)."""

    autopilot: int
    vehicle_type: int


class NotGranted(LinkEvent, frozen=True, tag="not_granted", kw_only=True):
    """The vehicle does not send ``message`` (at ``rate_hz``, or once if None): refused with a reason, or no answer."""

    message: str
    rate_hz: float | None
    reason: str


class IdentityClash(LinkEvent, frozen=True, tag="identity_clash", kw_only=True):
    """Somebody else sends with our system and component id: use another one."""

    system: int
    component: int


class BytesDiscarded(LinkEvent, frozen=True, tag="bytes_discarded", kw_only=True):
    """Bytes that belong to no valid frame came in since the last such event; reported at most once a second."""

    bad_bytes: int
    bad_checksums: int


AnyLinkEvent = (
    VehicleFound
    | VehicleLost
    | VehicleReturned
    | VehicleRebooted
    | AutopilotChanged
    | NotGranted
    | IdentityClash
    | BytesDiscarded
)
