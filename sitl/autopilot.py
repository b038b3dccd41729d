"""The simulated firmware's flight modes: arming and its refusals, take-off, hold, offboard, return, land, failsafes.

PX4's modes and words. All its times are vehicle time. It flies on its own estimate (:mod:`sitl.navigation`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from models.frames import Quaternion, Vec3
from sitl import inner_loop, position_control
from sitl.land_detector import LandDetector
from sitl.mission import Action, Mission
from sitl.modes import (
    ARMABLE_MODES,
    STICK_MODES,
    ActuatorTarget,
    AttitudeTarget,
    BodyVelocityTarget,
    Mode,
    OffboardTarget,
    RatesTarget,
    Result,
    Severity,
    Sticks,
)
from sitl.navigation import Navigation
from sitl.position_control import PositionControl, Target
from sitl.sensors import Sensors
from sitl.vehicle import QuadrotorVehicle
from sitl.vehicle_parameters import VehicleParameters

UPDATE_US = 20_000
_UPDATE_S = UPDATE_US * 1e-6
_STICKS_LOST_US = 500_000
_SLOWEST_SETPOINTS_HZ = 2.0


class Autopilot:
    """Modes and failsafes of one vehicle. ``announce`` takes what it has to say (STATUSTEXT)."""

    def __init__(
        self,
        vehicle: QuadrotorVehicle,
        navigation: Navigation,
        sensors: Sensors,
        parameters: VehicleParameters,
        mission: Mission,
        announce: Callable[[Severity, str], None],
    ) -> None:
        self.parameters = parameters
        self.mission = mission
        self.mode = Mode.LOITER
        self.armed = False
        self.home_ned_m: Vec3 = (0.0, 0.0, 0.0)
        self.cruise_m_s = parameters["MPC_XY_CRUISE"]
        self._vehicle = vehicle
        self._navigation = navigation
        self._sensors = sensors
        self._announce = announce
        self._control = PositionControl([0.0, 0.0, 0.0], 0.0)
        self._target = Target()
        self._returning = False
        self._offboard: OffboardTarget | None = None
        self._setpoint_times_us: deque[int] = deque(maxlen=4)
        self._offboard_lost_us: int | None = None
        self._sticks: Sticks | None = None
        self._land_detector = LandDetector(parameters)
        self._battery_warned = False

    # Commands

    def arm(self, *, force: bool = False) -> Result:
        """Arm, or refuse and say why."""
        if self.armed:
            return Result.ACCEPTED
        reason = None if force else self._arming_refusal()
        if reason is not None:
            self._announce(Severity.CRITICAL, f"Arming denied: {reason}")
            return Result.TEMPORARILY_REJECTED
        nav = self._navigation.state()
        self.armed = True
        self._land_detector.arm(self._vehicle.time_us)
        self.home_ned_m = nav.position_ned_m
        self._hold_here()
        self._announce(Severity.INFO, "Armed by external command")
        return Result.ACCEPTED

    def _arming_refusal(self) -> str | None:
        battery = self._sensors.battery.latest
        roll, pitch, _ = self._navigation.state().euler_rad
        if self.mode not in ARMABLE_MODES:
            return f"mode {self.mode.name} cannot be armed in, switch to Hold"
        if battery is not None and battery.remaining < self.parameters["BAT_CRIT_THR"]:
            return "battery critical"
        if max(abs(roll), abs(pitch)) > math.radians(60.0):
            return "vehicle is not level"
        if self.mode is Mode.OFFBOARD and not self._setpoints_alive():
            return "no offboard setpoints"
        if self.mode is Mode.MANUAL and self._sticks is not None and self._sticks.throttle > 0.2:
            return "throttle is not low"
        return None

    def disarm(self, *, force: bool = False) -> Result:
        """Disarm; in the air only with ``force``."""
        if self.armed and not self.landed and not force:
            self._announce(Severity.CRITICAL, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        if self.armed:
            self._stop("Disarmed by external command")
        return Result.ACCEPTED

    def _stop(self, text: str) -> None:
        self.armed = False
        self._vehicle.command[0] = inner_loop.OFF
        self._announce(Severity.INFO, text)
        if self.mode in (Mode.LAND, Mode.RTL, Mode.TAKEOFF, Mode.MISSION):
            self._enter(Mode.LOITER)

    def set_mode(self, mode: Mode) -> Result:
        """Change the flight mode, or refuse and say why."""
        if mode is Mode.OFFBOARD and not self._setpoints_alive():
            self._announce(Severity.CRITICAL, "Offboard denied: no setpoints above 2 Hz")
            return Result.TEMPORARILY_REJECTED
        if mode is Mode.MISSION and not self.mission.items:
            self._announce(Severity.CRITICAL, "Mission denied: no mission on board")
            return Result.TEMPORARILY_REJECTED
        if mode is Mode.TAKEOFF:
            return self.take_off(math.nan)
        if mode in STICK_MODES and self.armed and not self.landed and not self._sticks_alive():
            self._announce(Severity.CRITICAL, f"{mode.name} denied: no manual control input")
            return Result.TEMPORARILY_REJECTED
        self._enter(mode)
        return Result.ACCEPTED

    def take_off(self, height_ned_m: float) -> Result:
        """Climb to a height (ned down coordinate; NaN: MIS_TAKEOFF_ALT above here), then hold."""
        if not self.armed:
            self._announce(Severity.CRITICAL, "Takeoff denied: disarmed")
            return Result.TEMPORARILY_REJECTED
        if not self.landed:
            self._announce(Severity.WARNING, "Takeoff denied: already in the air")
            return Result.TEMPORARILY_REJECTED
        north, east, down = self._navigation.state().position_ned_m
        to = height_ned_m if math.isfinite(height_ned_m) else down - self.parameters["MIS_TAKEOFF_ALT"]
        self._enter(Mode.TAKEOFF)
        self._target = self._target._replace(
            position_ned_m=(north, east, to), climb_m_s=self.parameters["MPC_TKO_SPEED"]
        )
        return Result.ACCEPTED

    def reposition(self, position_ned_m: Vec3, yaw_rad: float, speed_m_s: float) -> Result:
        """Fly to a point and hold there; NaN entries keep what is."""
        if not self.armed or self.landed:
            self._announce(Severity.CRITICAL, "Reposition denied: not flying")
            return Result.TEMPORARILY_REJECTED
        if speed_m_s > 0.0:
            self.cruise_m_s = speed_m_s
        self._enter(Mode.LOITER)
        now = self._target.position_ned_m
        n, e, d = (given if math.isfinite(given) else kept for given, kept in zip(position_ned_m, now, strict=True))
        yaw = yaw_rad if math.isfinite(yaw_rad) else self._target.yaw_rad
        self._target = self._target._replace(position_ned_m=(n, e, d), yaw_rad=yaw, speed_m_s=self.cruise_m_s)
        return Result.ACCEPTED

    def receive_setpoint(self, target: OffboardTarget) -> None:
        """An offboard setpoint has arrived; attitude, rates and actuator setpoints act at the very next tick."""
        self._setpoint_times_us.append(self._vehicle.time_us)
        self._offboard = target
        if self.mode is Mode.OFFBOARD and self.armed and not isinstance(target, Target | BodyVelocityTarget):
            self._fly_direct(target)

    def receive_sticks(self, forward: float, right: float, throttle: float, yaw: float) -> None:
        """Manual control has arrived; moved sticks take the vehicle from automatic modes as COM_RC_OVERRIDE says."""
        self._sticks = Sticks(forward, right, throttle, yaw, self._vehicle.time_us)
        override = int(self.parameters["COM_RC_OVERRIDE"])
        allowed = override & 2 if self.mode is Mode.OFFBOARD else override & 1
        moved = max(abs(forward), abs(right), abs(yaw)) * 100.0 > self.parameters["COM_RC_STICK_OV"]
        if self.armed and not self.landed and self.mode not in STICK_MODES and allowed and moved:
            self._announce(Severity.WARNING, "Pilot took over using sticks")
            self._enter(Mode.POSCTL)

    # State shown in telemetry

    @property
    def landed(self) -> bool:
        """On the ground and recognised as such."""
        return self._land_detector.landed

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE: 1 on ground, 2 in air, 3 taking off, 4 landing."""
        if self.landed:
            return 1
        if self.mode is Mode.TAKEOFF:
            return 3
        return 4 if self.mode is Mode.LAND else 2

    @property
    def attitude_target(self) -> Quaternion:
        """The attitude the inner loop is following."""
        _, w, x, y, z, _ = self._vehicle.command.tolist()
        return (w, x, y, z)

    def _setpoint_age_s(self) -> float:
        if not self._setpoint_times_us:
            return math.inf
        return (self._vehicle.time_us - self._setpoint_times_us[-1]) * 1e-6

    def _setpoints_alive(self) -> bool:
        times = self._setpoint_times_us
        if len(times) < 2 or self._setpoint_age_s() > self.parameters["COM_OF_LOSS_T"]:
            return False
        return (times[-1] - times[0]) * 1e-6 < (len(times) - 1) / _SLOWEST_SETPOINTS_HZ

    def _sticks_alive(self) -> bool:
        return self._sticks is not None and self._vehicle.time_us - self._sticks.time_us <= _STICKS_LOST_US

    # Flying

    def update(self) -> None:
        """Failsafes, mode logic and outer loops; call every UPDATE_US of vehicle time."""
        now_us = self._vehicle.time_us
        if self._land_detector.update(now_us, on_ground=self._vehicle.on_ground) and self.armed:
            self._announce(Severity.INFO, "Landing detected")
        reason = self._land_detector.disarm_reason(now_us) if self.armed else None
        if reason is not None:
            self._stop(reason)
        if not self.armed:
            self._vehicle.command[0] = inner_loop.OFF
            return
        self._failsafes()
        match self.mode:
            case Mode.OFFBOARD:
                self._fly_offboard()
            case Mode.MANUAL | Mode.ALTCTL | Mode.POSCTL:
                self._fly_sticks()
            case _:
                self._advance_automatic()
                self._fly_target()

    def _enter(self, mode: Mode) -> None:
        if mode is not self.mode:
            self.mode = mode
        self._offboard_lost_us = None
        self._returning = False
        self._hold_here()
        if mode is Mode.LAND:
            n, e, _ = self._target.position_ned_m
            self._land_at(n, e)

    def _land_at(self, north_m: float, east_m: float) -> None:
        self._target = self._target._replace(
            position_ned_m=(north_m, east_m, math.nan),
            velocity_ned_m_s=(math.nan, math.nan, self.parameters["MPC_LAND_SPEED"]),
        )

    def _hold_here(self) -> None:
        nav = self._navigation.state()
        if self._vehicle.command[0] != inner_loop.ATTITUDE:
            self._control.reset(nav.euler_rad[2])
        self._target = Target(nav.position_ned_m, yaw_rad=nav.euler_rad[2], speed_m_s=self.cruise_m_s)

    def _fly_target(self) -> None:
        """Follow the target of an automatic mode; standing, only take-off and missions leave the ground."""
        leaves = self.mode in (Mode.TAKEOFF, Mode.MISSION)
        self._fly(self._target if leaves or not self.landed else Target())

    def _fly(self, target: Target) -> None:
        parameters = self._vehicle.parameters
        out = position_control.step(
            self._control,
            target,
            self._navigation.state(),
            self.parameters,
            mass_kg=parameters.mass_kg,
            max_thrust_n=parameters.max_thrust_n,
            standing=self.landed,
            dt_s=_UPDATE_S,
        )
        if out.idle:
            self._vehicle.command[:5] = (inner_loop.TORQUE, 0.0, 0.0, 0.0, 0.0)
        else:
            self._vehicle.command[:] = (inner_loop.ATTITUDE, *out.ned_from_body, out.thrust_n)

    def _fly_direct(self, target: AttitudeTarget | RatesTarget | ActuatorTarget) -> None:
        full = self._vehicle.parameters.max_thrust_n
        command = self._vehicle.command
        match target:
            case AttitudeTarget(attitude, thrust):
                command[:] = (inner_loop.ATTITUDE, *attitude, thrust * full)
            case RatesTarget(rates, thrust):
                command[:5] = (inner_loop.RATES, *rates, thrust * full)
            case ActuatorTarget((roll, pitch, yaw, thrust)):
                sx, sy, sz = self._vehicle.parameters.torque_scale_n_m
                command[:5] = (inner_loop.TORQUE, roll * sx, pitch * sy, yaw * sz, thrust * full)

    def _fly_offboard(self) -> None:
        target = self._offboard
        if isinstance(target, BodyVelocityTarget):
            yaw = self._navigation.state().euler_rad[2]
            forward, right, down = target.velocity_m_s
            c, s = math.cos(yaw), math.sin(yaw)
            velocity = (c * forward - s * right, s * forward + c * right, down)
            self._fly(Target(velocity_ned_m_s=velocity, yaw_rad=target.yaw_rad, yaw_rate_rad_s=target.yaw_rate_rad_s))
        elif isinstance(target, Target):
            self._fly(target)
        elif target is not None:
            self._fly_direct(target)

    def _fly_sticks(self) -> None:
        sticks = self._sticks
        if sticks is None or not self._sticks_alive():
            self._fly_target()
            return
        nav = self._navigation.state()
        c, s = math.cos(nav.euler_rad[2]), math.sin(nav.euler_rad[2])
        climb = -2.0 * (sticks.throttle - 0.5) * self.parameters["MPC_Z_VEL_MAX_DN"]
        if self.mode is Mode.POSCTL:
            forward, right = sticks.forward * self.cruise_m_s, sticks.right * self.cruise_m_s
            velocity = (c * forward - s * right, s * forward + c * right, climb)
            self._fly(Target(velocity_ned_m_s=velocity, yaw_rate_rad_s=sticks.yaw * 1.5))
        else:
            reach = math.radians(self.parameters["MPC_TILTMAX_AIR"])
            self._control.yaw_rad += sticks.yaw * 1.5 * _UPDATE_S
            tilt = position_control.quaternion(sticks.right * reach, -sticks.forward * reach, self._control.yaw_rad)
            if self.mode is Mode.MANUAL:
                thrust = sticks.throttle
            else:
                self._fly(Target(velocity_ned_m_s=(math.nan, math.nan, climb), yaw_rate_rad_s=0.0))
                thrust = float(self._vehicle.command[5]) / self._vehicle.parameters.max_thrust_n
            if not (self.landed and sticks.throttle <= 0.5):
                self._fly_direct(AttitudeTarget(tilt, thrust))
        self._target = Target(nav.position_ned_m, yaw_rad=nav.euler_rad[2], speed_m_s=self.cruise_m_s)

    def _advance_automatic(self) -> None:
        nav = self._navigation.state()
        if self.mode is Mode.TAKEOFF:
            if abs(nav.position_ned_m[2] - self._target.position_ned_m[2]) < 0.15 and not self.landed:
                target = self._target._replace(climb_m_s=math.inf)
                self._enter(Mode.LOITER)
                self._target = target
        elif self.mode is Mode.RTL:
            self._advance_return(nav.position_ned_m)
        elif self.mode is Mode.MISSION:
            step = self.mission.advance(nav.position_ned_m, self._vehicle.time_us, landed=self.landed)
            if step.action is Action.LAND:
                self._land_at(*step.position_ned_m[:2])
            elif step.action is Action.DONE:
                self._announce(Severity.INFO, "Mission finished, loitering")
                self._enter(Mode.LOITER)
            elif step.action is Action.RETURN:
                self._enter(Mode.RTL)
            else:
                self._target = Target(step.position_ned_m, yaw_rad=self._target.yaw_rad, speed_m_s=self.cruise_m_s)

    def _advance_return(self, position: Vec3) -> None:
        home_n, home_e, home_d = self.home_ned_m
        away = math.hypot(position[0] - home_n, position[1] - home_e)
        if away < 0.5:
            self._land_at(home_n, home_e)
            return
        if not self._returning:
            height = min(position[2], home_d - self.parameters["RTL_RETURN_ALT"]) if away > 3.0 else position[2]
            self._target = self._target._replace(position_ned_m=(position[0], position[1], height))
            self._returning = True
        if abs(position[2] - self._target.position_ned_m[2]) < 0.5:
            height = self._target.position_ned_m[2]
            self._target = self._target._replace(position_ned_m=(home_n, home_e, height))

    # Failsafes

    def _failsafes(self) -> None:
        if self.mode is Mode.OFFBOARD and self._setpoint_age_s() > self.parameters["COM_OF_LOSS_T"]:
            self._announce(Severity.CRITICAL, "Offboard control lost: holding")
            self._enter(Mode.LOITER)
            self._offboard_lost_us = self._vehicle.time_us
        if self._offboard_lost_us is not None and self.parameters["COM_OBL_RC_ACT"] == 4:
            held_s = (self._vehicle.time_us - self._offboard_lost_us) * 1e-6
            if held_s > self.parameters["SIM_OBL_HOLD_T"] and not self.landed:
                self._announce(Severity.CRITICAL, "Offboard control lost: landing")
                self._enter(Mode.LAND)
        if self.mode in STICK_MODES and self._sticks is not None and not self._sticks_alive() and not self.landed:
            self._announce(Severity.CRITICAL, "Manual control lost: holding")
            self._sticks = None
            self._enter(Mode.LOITER)
        battery = self._sensors.battery.latest
        if battery is not None and battery.remaining < self.parameters["BAT_LOW_THR"] and not self._battery_warned:
            self._battery_warned = True
            self._announce(Severity.WARNING, "Battery low")
