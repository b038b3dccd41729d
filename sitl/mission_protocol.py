"""Mission upload, download and clearing on one link; lost items are asked for again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from sitl.mission import NAV_LAND, NAV_LOITER_TIME, NAV_RETURN_TO_LAUNCH, NAV_TAKEOFF, NAV_WAYPOINT, Item, Mission
from sitl.vehicle import QuadrotorVehicle

ACCEPTED, ERROR, UNSUPPORTED, NO_SPACE, INVALID_SEQUENCE = 0, 1, 3, 4, 13
_CAPACITY = 500
_RESEND_US = 500_000
_RESENDS = 5
_SUPPORTED = (NAV_WAYPOINT, NAV_LOITER_TIME, NAV_LAND, NAV_TAKEOFF, NAV_RETURN_TO_LAUNCH)


@dataclass(slots=True)
class _Upload:
    mission_type: int
    count: int
    peer: tuple[int, int]
    asked_us: int
    resent: int = 0
    items: list[Item] = field(default_factory=list)


class MissionProtocol:
    """The vehicle's side of the mission protocol with one peer at a time."""

    def __init__(
        self,
        mission: Mission,
        vehicle: QuadrotorVehicle,
        reply: Callable[[str, dict[str, Any]], None],
        store: Callable[[int, list[Item]], None],
    ) -> None:
        self._mission = mission
        self._vehicle = vehicle
        self._reply = reply
        self._store = store
        self._upload: _Upload | None = None

    def receive(self, kind: str, message: Any) -> None:
        """Act on a MISSION_ message."""
        peer = (message.get_srcSystem(), message.get_srcComponent())
        mission_type = getattr(message, "mission_type", 0)
        if mission_type not in self._mission.stored:
            if kind in ("MISSION_COUNT", "MISSION_REQUEST_LIST", "MISSION_CLEAR_ALL"):
                self._acknowledge(peer, UNSUPPORTED, mission_type)
            return
        match kind:
            case "MISSION_COUNT":
                self._start_upload(peer, mission_type, message.count)
            case "MISSION_ITEM_INT":
                self._take_item(message)
            case "MISSION_REQUEST_LIST":
                count = len(self._mission.stored[mission_type])
                self._reply("MISSION_COUNT", self._to(peer, count=count, mission_type=mission_type))
            case "MISSION_REQUEST_INT":
                self._send_item(peer, mission_type, message.seq)
            case "MISSION_CLEAR_ALL":
                self._store(mission_type, [])
                self._acknowledge(peer, ACCEPTED, mission_type)
            case "MISSION_SET_CURRENT":
                self._mission.go_to(message.seq)

    def poll(self, time_us: int) -> None:
        """Ask again for an item that did not come; give up after a few times."""
        upload = self._upload
        if upload is None or time_us - upload.asked_us < _RESEND_US:
            return
        if upload.resent >= _RESENDS:
            self._upload = None
            self._acknowledge(upload.peer, ERROR, upload.mission_type)
            return
        upload.resent += 1
        self._ask(upload)

    def _start_upload(self, peer: tuple[int, int], mission_type: int, count: int) -> None:
        if count > _CAPACITY:
            self._acknowledge(peer, NO_SPACE, mission_type)
        elif count == 0:
            self._store(mission_type, [])
            self._acknowledge(peer, ACCEPTED, mission_type)
        else:
            self._upload = _Upload(mission_type, count, peer, self._vehicle.time_us)
            self._ask(self._upload)

    def _ask(self, upload: _Upload) -> None:
        upload.asked_us = self._vehicle.time_us
        fields = self._to(upload.peer, seq=len(upload.items), mission_type=upload.mission_type)
        self._reply("MISSION_REQUEST_INT", fields)

    def _take_item(self, message: Any) -> None:
        upload = self._upload
        if upload is None or message.mission_type != upload.mission_type:
            return
        if message.seq != len(upload.items):
            # A repeat of an item already taken is harmless; one from the future is asked for in order.
            if message.seq > len(upload.items):
                self._ask(upload)
            return
        if upload.mission_type == 0 and 16 <= message.command <= 95 and message.command not in _SUPPORTED:
            self._upload = None
            self._acknowledge(upload.peer, UNSUPPORTED, upload.mission_type)
            return
        p1, p2, p3, p4 = message.param1, message.param2, message.param3, message.param4
        upload.items.append(
            Item(
                *(message.frame, message.command, message.autocontinue),
                *(p1, p2, p3, p4, message.x, message.y, message.z),
            )
        )
        upload.resent = 0
        if len(upload.items) == upload.count:
            self._upload = None
            self._store(upload.mission_type, upload.items)
            self._acknowledge(upload.peer, ACCEPTED, upload.mission_type)
        else:
            self._ask(upload)

    def _send_item(self, peer: tuple[int, int], mission_type: int, sequence: int) -> None:
        items = self._mission.stored[mission_type]
        if sequence >= len(items):
            self._acknowledge(peer, INVALID_SEQUENCE, mission_type)
            return
        item = items[sequence]
        current = int(mission_type == 0 and sequence == self._mission.current)
        fields = {**item._asdict(), "seq": sequence, "current": current, "mission_type": mission_type}
        self._reply("MISSION_ITEM_INT", self._to(peer, **fields))

    def _acknowledge(self, peer: tuple[int, int], result: int, mission_type: int) -> None:
        self._reply("MISSION_ACK", self._to(peer, type=result, mission_type=mission_type))

    @staticmethod
    def _to(peer: tuple[int, int], **fields: Any) -> dict[str, Any]:
        return {"target_system": peer[0], "target_component": peer[1], **fields}
