"""Missions: what was uploaded, and flying it one item after another."""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

from models.frames import Geodetic, Vec3, ned_from_geodetic

NAV_WAYPOINT, NAV_LOITER_TIME, NAV_RETURN_TO_LAUNCH, NAV_LAND, NAV_TAKEOFF = 16, 19, 20, 21, 22
_GLOBAL_FRAMES = (0, 5)
_DEFAULT_ACCEPTANCE_M = 0.7


class Item(NamedTuple):
    """A MISSION_ITEM_INT as it was uploaded; x and y are degE7, z is metres in ``frame``."""

    frame: int
    command: int
    autocontinue: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float


class Action(Enum):
    """What the mission wants now."""

    GO = "go"
    LAND = "land"
    RETURN = "return"
    DONE = "done"


class Step(NamedTuple):
    """An action and the point it is about, ned [m]."""

    action: Action
    position_ned_m: Vec3


class Mission:
    """The items on board (by MAV_MISSION_TYPE: 0 mission, 1 fence, 2 rally) and how far the flight has come.

    ``reached`` is the last item reached and not yet reported, or None.
    """

    def __init__(self, origin: Geodetic) -> None:
        self.stored: dict[int, list[Item]] = {0: [], 1: [], 2: []}
        self.current = 0
        self.reached: int | None = None
        self._origin = origin
        self._arrived_us: int | None = None

    @property
    def items(self) -> list[Item]:
        """The items of the mission proper."""
        return self.stored[0]

    def replace(self, mission_type: int, items: list[Item]) -> None:
        """Put a new plan on board; a new mission starts at its first item."""
        self.stored[mission_type] = items
        if mission_type == 0:
            self.go_to(0)

    def go_to(self, index: int) -> bool:
        """Make an item the current one; False if there is none of that number."""
        if index and not 0 <= index < len(self.items):
            return False
        self.current = index
        self.reached = None
        self._arrived_us = None
        return True

    def position_of(self, item: Item) -> Vec3:
        """Where an item is, ned [m]; coordinates of zero mean 'here' and come back as NaN."""
        height = item.z if item.frame in _GLOBAL_FRAMES else item.z + self._origin.height_m
        north, east, down = ned_from_geodetic(
            Geodetic(math.radians(item.x * 1e-7), math.radians(item.y * 1e-7), height), self._origin
        )
        return (math.nan, math.nan, down) if item.x == 0 and item.y == 0 else (north, east, down)

    def advance(self, position_ned_m: Vec3, time_us: int, *, landed: bool) -> Step:
        """What to do now, moving on to the next item when this one is reached."""
        while self.current < len(self.items):
            item = self.items[self.current]
            if item.command == NAV_RETURN_TO_LAUNCH:
                self._next()
                return Step(Action.RETURN, position_ned_m)
            if item.command not in (NAV_WAYPOINT, NAV_LOITER_TIME, NAV_LAND, NAV_TAKEOFF):
                self._next()
                continue
            wanted = self.position_of(item)
            n, e, d = (w if math.isfinite(w) else p for w, p in zip(wanted, position_ned_m, strict=True))
            if item.command == NAV_LAND:
                if math.hypot(n - position_ned_m[0], e - position_ned_m[1]) > 1.0 and not landed:
                    return Step(Action.GO, (n, e, position_ned_m[2]))
                return Step(Action.LAND, (n, e, d))
            near = item.param2 if item.param2 > 0.0 else _DEFAULT_ACCEPTANCE_M
            if math.dist((n, e, d), position_ned_m) > near:
                return Step(Action.GO, (n, e, d))
            if self._arrived_us is None:
                self._arrived_us = time_us
            hold_s = item.param1 if item.command in (NAV_WAYPOINT, NAV_LOITER_TIME) else 0.0
            if (time_us - self._arrived_us) * 1e-6 < (hold_s if math.isfinite(hold_s) else 0.0):
                return Step(Action.GO, (n, e, d))
            self._next()
        return Step(Action.DONE, position_ned_m)

    def _next(self) -> None:
        self.reached = self.current
        self.current += 1
        self._arrived_us = None
