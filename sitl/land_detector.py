"""When the vehicle counts as landed, and when that should disarm it."""

from __future__ import annotations

from sitl.vehicle_parameters import VehicleParameters

_LANDED_AFTER_US = 500_000


class LandDetector:
    """Half a second of standing is landed; any lift-off is flying. ``landed`` is what the last update found."""

    def __init__(self, parameters: VehicleParameters) -> None:
        self.landed = True
        self._parameters = parameters
        self._contact_us: int | None = 0
        self._armed_us = 0
        self._flown = False

    def arm(self, time_us: int) -> None:
        """The motors have been armed."""
        self._armed_us = time_us
        self._flown = not self.landed

    def update(self, time_us: int, *, on_ground: bool) -> bool:
        """Look again; True at the moment of landing."""
        if not on_ground:
            self._contact_us, self.landed, self._flown = None, False, True
            return False
        if self._contact_us is None:
            self._contact_us = time_us
        if self.landed or time_us - self._contact_us < _LANDED_AFTER_US:
            return False
        self.landed = True
        return True

    def disarm_reason(self, time_us: int) -> str | None:
        """Why an armed vehicle should be disarmed by now (COM_DISARM_LAND, COM_DISARM_PRFLT; negative: never)."""
        if not self.landed or self._contact_us is None:
            return None
        if self._flown:
            wait_s, since_us, reason = self._parameters["COM_DISARM_LAND"], self._contact_us, "Disarmed by landing"
        else:
            wait_s, since_us, reason = self._parameters["COM_DISARM_PRFLT"], self._armed_us, "Disarmed: no takeoff"
        return reason if wait_s >= 0.0 and (time_us - since_us) * 1e-6 > wait_s else None
