"""One vehicle in its air: plant, wind, inner loops and the integrating IMU, advanced together tick by tick.

A tick is 2 ms, so that IMU messages at 50, 100, 125 or 250 Hz are evenly spaced.
All random numbers of the ticks come from one generator in blocks of fixed size, so a flight does not depend on how
the time was cut into calls nor on which messages were asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.frames import STANDARD_GRAVITY_M_S2, Array, Vec3
from models.kernel import kernel
from models.parameters import QuadrotorParameters
from sitl import inner_loop
from sitl.plants import quadrotor
from sitl.wind import GUST_STATES, Wind, step_wind, wind_constants

TICK_US = 2000
TICK_S = TICK_US * 1e-6
_BLOCK_TICKS = 512
_DRAWS = 15


@dataclass(frozen=True, slots=True)
class ImuConfig:
    """Inertial sensor: white noise densities, bias walks and the 1-sigma of the biases at power-on, per axis.

    Noise of spec section 3; the sensor integrates, so a sample is the mean since the previous one, stamped at its end.
    ``rate_hz`` is the rate streamed before anybody asks for another; ``delay_s`` holds a sample back after its stamp.
    """

    gyro_noise_rad_s_sqrt_hz: float = 1e-3
    accel_noise_m_s2_sqrt_hz: float = 1e-2
    gyro_bias_walk_rad_s_sqrt_s: float = 2e-4
    accel_bias_walk_m_s2_sqrt_s: float = 2e-3
    gyro_bias_sigma_rad_s: float = 3e-3
    accel_bias_sigma_m_s2: float = 3e-2
    rate_hz: float = 100.0
    delay_s: float = 0.0


@kernel(
    "void(i8, f8[:,::1], f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1],"
    " f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])"
)
def run_ticks(
    count: int,
    noise: Array,
    dt_s: float,
    state: Array,
    gust: Array,
    wind_ned_m_s: Array,
    wind: Array,
    disturbance: Array,
    command: Array,
    attitude_error_rad: Array,
    integral: Array,
    rotor_command_rad_s: Array,
    scalars: Array,
    inertia: Array,
    inertia_inverse: Array,
    moments: Array,
    imu_noise: Array,
    imu_bias: Array,
    imu_integral: Array,
    flags: Array,
    work: Array,
) -> None:
    """Advance ``count`` ticks in place with the rows of ``noise``: gust, control, plant, then IMU integrals.

    ``imu_integral`` (6,): measured angle [rad] and specific force x time [m/s]; ``imu_bias`` (6,); ``imu_noise`` (4,):
    gyro, accel white and gyro, accel walk. ``flags`` (5,): on the ground, mixer shedding, true specific force (3).
    """
    root = math.sqrt(dt_s)
    before = work[6 * quadrotor.STATE_SIZE : 7 * quadrotor.STATE_SIZE]
    for k in range(count):
        draw = noise[k]
        air_n, air_e = state[3] - wind_ned_m_s[0], state[4] - wind_ned_m_s[1]
        air_d = state[5] - wind_ned_m_s[2]
        airspeed = math.sqrt(air_n * air_n + air_e * air_e + air_d * air_d)
        step_wind(gust, wind, -state[2], airspeed, dt_s, draw[12:15], wind_ned_m_s)
        flags[1] = inner_loop.control(
            command, state, attitude_error_rad, integral, scalars, inertia, dt_s, rotor_command_rad_s
        )
        for i in range(13):
            before[i] = state[i]
        flags[0] = quadrotor.step(
            state,
            dt_s,
            rotor_command_rad_s,
            wind_ned_m_s,
            disturbance,
            scalars,
            inertia,
            inertia_inverse,
            moments,
            work,
        )
        # Specific force from the change of velocity (so a touchdown is felt), seen from the attitude half-way.
        fx = (state[3] - before[3]) / dt_s
        fy = (state[4] - before[4]) / dt_s
        fz = (state[5] - before[5]) / dt_s - STANDARD_GRAVITY_M_S2
        w, x, y, z = (
            state[6] + before[6],
            state[7] + before[7],
            state[8] + before[8],
            state[9] + before[9],
        )
        n = 1.0 / (w * w + x * x + y * y + z * z)
        b0 = n * ((w * w + x * x - y * y - z * z) * fx + 2.0 * (x * y + w * z) * fy + 2.0 * (x * z - w * y) * fz)
        b1 = n * (2.0 * (x * y - w * z) * fx + (w * w - x * x + y * y - z * z) * fy + 2.0 * (y * z + w * x) * fz)
        b2 = n * (2.0 * (x * z + w * y) * fx + 2.0 * (y * z - w * x) * fy + (w * w - x * x - y * y + z * z) * fz)
        flags[2], flags[3], flags[4] = b0, b1, b2
        standing = flags[0] > 0.0
        for i in range(3):
            turned = state[10 + i] if standing else 0.5 * (before[10 + i] + state[10 + i])
            imu_integral[i] += dt_s * (turned + imu_bias[i]) + root * imu_noise[0] * draw[i]
            imu_bias[i] += root * imu_noise[2] * draw[6 + i]
            imu_bias[3 + i] += root * imu_noise[3] * draw[9 + i]
        imu_integral[3] += dt_s * (b0 + imu_bias[3]) + root * imu_noise[1] * draw[3]
        imu_integral[4] += dt_s * (b1 + imu_bias[4]) + root * imu_noise[1] * draw[4]
        imu_integral[5] += dt_s * (b2 + imu_bias[5]) + root * imu_noise[1] * draw[5]


class QuadrotorVehicle:
    """Truth of one simulated quadrotor; its arrays are mutated in place by :meth:`advance`.

    ``state`` (17,) as in :mod:`sitl.plants.quadrotor`; ``command`` (6,) as in :mod:`sitl.inner_loop`;
    ``disturbance`` (6,): force ned [N] and torque body [N m] added to the plant.
    """

    def __init__(
        self,
        parameters: QuadrotorParameters,
        wind: Wind,
        imu: ImuConfig,
        generator: np.random.Generator,
        yaw_rad: float = 0.0,
    ) -> None:
        self.parameters = parameters
        self.tick = 0
        self.state = quadrotor.initial_state(yaw_rad)
        self.command = np.zeros(inner_loop.COMMAND_SIZE)
        self.attitude_error_rad = np.zeros(3)
        self.disturbance = np.zeros(6)
        self.wind_ned_m_s = np.array(wind.mean_ned_m_s, dtype=np.float64)
        self.rotor_command_rad_s = np.zeros(4)
        self.imu_integral = np.zeros(6)
        self.imu_bias = generator.standard_normal(6) * np.repeat(
            [imu.gyro_bias_sigma_rad_s, imu.accel_bias_sigma_m_s2], 3
        )
        self._imu_noise = np.array(
            [
                imu.gyro_noise_rad_s_sqrt_hz,
                imu.accel_noise_m_s2_sqrt_hz,
                imu.gyro_bias_walk_rad_s_sqrt_s,
                imu.accel_bias_walk_m_s2_sqrt_s,
            ]
        )
        self._constants = quadrotor.constants_of(parameters)
        self._generator = generator
        self._gust = generator.standard_normal(GUST_STATES)
        self._wind = wind_constants(wind)
        self._integral = np.zeros(3)
        self._flags = np.array([1.0, 0.0, 0.0, 0.0, -STANDARD_GRAVITY_M_S2])
        self._work = np.zeros(quadrotor.WORK_SIZE)
        self._noise = generator.standard_normal((_BLOCK_TICKS, _DRAWS))

    @property
    def time_us(self) -> int:
        """Vehicle time since power-on [us]."""
        return self.tick * TICK_US

    @property
    def on_ground(self) -> bool:
        """Standing with its weight not lifted."""
        return bool(self._flags[0] > 0.0)

    @property
    def specific_force_body_m_s2(self) -> Vec3:
        """True specific force of the last tick."""
        return (float(self._flags[2]), float(self._flags[3]), float(self._flags[4]))

    def advance(self, until_tick: int) -> None:
        """Run ticks until ``until_tick``; does nothing if that is not ahead."""
        while self.tick < until_tick:
            row = self.tick % _BLOCK_TICKS
            if row == 0 and self.tick > 0:
                self._generator.standard_normal(out=self._noise)
            count = min(until_tick - self.tick, _BLOCK_TICKS - row)
            run_ticks(
                count,
                self._noise[row:],
                TICK_S,
                self.state,
                self._gust,
                self.wind_ned_m_s,
                self._wind,
                self.disturbance,
                self.command,
                self.attitude_error_rad,
                self._integral,
                self.rotor_command_rad_s,
                *self._constants,
                self._imu_noise,
                self.imu_bias,
                self.imu_integral,
                self._flags,
                self._work,
            )
            self.tick += count
