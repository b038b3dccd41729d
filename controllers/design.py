"""What a gain set will do before it flies: true closed-loop poles, margins and step responses of the whole cascade.

The model holds rotor lag and delay (transport plus half a control period for the hold of the command), and every loop
is closed while one is cut: torques and thrust at the actuator, x and y at the tilt command. Limits are those an
operator is warned of, not those of stability.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np
import numpy.typing as npt

from controllers.closed_loop import LOOPS, ClosedLoop, closed_loop, frequency_response, inner_loop, step_responses
from controllers.flight_controller import prepare
from controllers.gains import GainSet
from controllers.law import CascadeLaw
from models.frames import Array
from models.parameters import QuadrotorParameters

LEAST_PHASE_MARGIN_DEG = 30.0
LEAST_GAIN_MARGIN_DB = 6.0
LEAST_DELAY_MARGIN_S = 0.040
GREATEST_SENSITIVITY = 2.3
SETTLING_BAND = 0.02
OMEGA_RAD_S: Array = np.geomspace(0.02, 300.0, 420)


@dataclass(frozen=True, slots=True)
class ModelOptions:
    """What the prediction assumes beyond the vehicle: transport delay of the link [s] and control period [s]."""

    transport_delay_s: float = 0.010
    control_period_s: float = 0.010

    @property
    def delay_s(self) -> float:
        """Delay in the loop: transport, and half a period for the hold of the command."""
        return self.transport_delay_s + 0.5 * self.control_period_s


@dataclass(frozen=True, slots=True)
class StepSpecification:
    """Step of one axis in Raja 4.3.2: size, its unit, limits of overshoot and rise time, and how long to look."""

    size: float
    unit: str
    command_unit: str
    overshoot_percent: float
    rise_s: float
    duration_s: float


STEP_SPECIFICATIONS: dict[str, StepSpecification] = {
    "roll": StepSpecification(0.1, "rad", "N m", 20.0, 0.5, 3.0),
    "pitch": StepSpecification(0.1, "rad", "N m", 20.0, 0.5, 3.0),
    "yaw": StepSpecification(0.1, "rad", "N m", 5.0, 0.7, 3.0),
    "height": StepSpecification(0.5, "m", "N", 15.0, 1.5, 12.0),
    "x": StepSpecification(0.5, "m", "rad", 10.0, 2.0, 12.0),
    "y": StepSpecification(0.5, "m", "rad", 10.0, 2.0, 12.0),
}
STEP_SAMPLES = 241


class Pole(msgspec.Struct, frozen=True):
    """A closed-loop pole [1/s] (of a pair, the upper one) with damping ratio and the state that takes part most."""

    real: float
    imag: float
    damping: float
    natural_rad_s: float
    state: str


class StepPrediction(msgspec.Struct, frozen=True):
    """Predicted response to a step of ``size`` [``unit``] and the command that makes it [``command_unit``].

    Rise is from 10 to 90 %, settling to within 2 %; None where it does not come to pass within the time shown.
    """

    size: float
    unit: str
    command_unit: str
    time_s: tuple[float, ...]
    value: tuple[float, ...]
    command: tuple[float, ...]
    overshoot_percent: float | None
    rise_s: float | None
    settling_s: float | None
    overshoot_limit_percent: float
    rise_limit_s: float


class LoopReport(msgspec.Struct, frozen=True):
    """Margins of one loop with all others closed. None: no crossing, so no limit; all None when unstable.

    ``gain_margin_db`` is the nearest to instability of raising and lowering the gain (``gain_raise_db`` > 0,
    ``gain_lower_db`` < 0).
    """

    name: str
    crossover_rad_s: float | None
    phase_margin_deg: float | None
    gain_margin_db: float | None
    gain_raise_db: float | None
    gain_lower_db: float | None
    delay_margin_s: float | None
    peak_sensitivity: float | None
    bandwidth_rad_s: float | None
    step: StepPrediction


class DesignWarning(msgspec.Struct, frozen=True):
    """One soft limit that is not kept; ``text`` is worded for an operator."""

    loop: str
    quantity: Literal["stability", "phase", "gain", "delay", "sensitivity", "overshoot", "rise"]
    value: float | None
    limit: float | None
    text: str


class DesignReport(msgspec.Struct, frozen=True):
    """All of it. ``gains`` are the matrices as flown, by name; ``poles`` are of the whole cascade, slowest first."""

    controller: Literal["lqr", "pid"]
    name: str
    stable: bool
    inner_stable: bool
    motor_lag_s: float
    delay_s: float
    gains: dict[str, tuple[tuple[float, ...], ...]]
    poles: tuple[Pole, ...]
    inner_poles: tuple[Pole, ...]
    loops: tuple[LoopReport, ...]
    warnings: tuple[DesignWarning, ...]


def predict(gain_set: GainSet, parameters: QuadrotorParameters, options: ModelOptions | None = None) -> DesignReport:
    """Poles, margins and steps of a gain set on the reference model with rotor lag and delay.

    Raises numpy.linalg.LinAlgError if an LQR loop cannot be designed; an unstable loop is reported, not raised.
    """
    options = options or ModelOptions()
    law = prepare(gain_set, parameters)
    whole = closed_loop(law, parameters, parameters.rotor_lag_s, options.delay_s)
    inner = inner_loop(law, parameters, parameters.rotor_lag_s, options.delay_s)
    poles, inner_poles = poles_of(whole), poles_of(inner)
    stable, inner_stable = poles[0].real < 0.0, inner_poles[0].real < 0.0
    margins = _margins(whole) if stable else dict.fromkeys(LOOPS, NO_MARGINS)
    bandwidths = _bandwidths(whole, inner) if stable and inner_stable else dict.fromkeys(LOOPS)
    steps = _steps(whole, inner)
    loops = tuple(
        LoopReport(
            name=name,
            crossover_rad_s=margins[name].crossover_rad_s,
            phase_margin_deg=margins[name].phase_deg,
            gain_margin_db=margins[name].nearest_gain_db,
            gain_raise_db=margins[name].gain_raise_db,
            gain_lower_db=margins[name].gain_lower_db,
            delay_margin_s=margins[name].delay_s,
            peak_sensitivity=margins[name].peak_sensitivity,
            bandwidth_rad_s=bandwidths[name],
            step=steps[name],
        )
        for name in LOOPS
    )
    return DesignReport(
        controller=law.kind,
        name=law.name,
        stable=stable,
        inner_stable=inner_stable,
        motor_lag_s=parameters.rotor_lag_s,
        delay_s=options.delay_s,
        gains=_gain_tables(law),
        poles=poles,
        inner_poles=inner_poles,
        loops=loops,
        warnings=_warnings(stable, inner_stable, loops),
    )


def poles_of(loop: ClosedLoop) -> tuple[Pole, ...]:
    """Poles of a closed loop, slowest first, one of each conjugate pair, labelled by their dominant state."""
    values, vectors = np.linalg.eig(loop.a)
    try:
        participation = np.abs(vectors * np.linalg.inv(vectors).T)
    except np.linalg.LinAlgError:
        participation = np.abs(vectors)
    dominant = participation.argmax(axis=0)
    upper = [index for index in range(values.size) if values[index].imag >= 0.0]
    upper.sort(key=lambda index: -values[index].real)
    return tuple(_pole(complex(values[index]), loop.names[dominant[index]]) for index in upper)


def _pole(value: complex, state: str) -> Pole:
    natural = abs(value)
    return Pole(value.real, value.imag, -value.real / natural if natural > 0.0 else 0.0, natural, state)


@dataclass(frozen=True, slots=True)
class Margins:
    """Margins of one cut loop; None where there is no crossing."""

    crossover_rad_s: float | None
    phase_deg: float | None
    gain_raise_db: float | None
    gain_lower_db: float | None
    delay_s: float | None
    peak_sensitivity: float | None

    @property
    def nearest_gain_db(self) -> float | None:
        """The smaller of the two gain margins [dB], as a magnitude."""
        return min((abs(g) for g in (self.gain_raise_db, self.gain_lower_db) if g is not None), default=None)


NO_MARGINS = Margins(None, None, None, None, None, None)


def margins_of(loop_gain: npt.NDArray[np.complex128], omega_rad_s: Array) -> Margins:
    """Margins of a loop gain L (w,), negative feedback, sampled finely on a logarithmic grid.

    Phase: the smallest over all crossings |L| = 1. Delay: the smallest phase lag over frequency that closes it.
    Gain: at the crossings of -180 deg. Peak sensitivity: max |1 / (1 + L)|. The closed loop must be stable.
    """
    log_w, log_gain = np.log(omega_rad_s), np.log(np.abs(loop_gain))
    phase_deg = np.degrees(np.unwrap(np.angle(loop_gain)))
    crossover_rad_s, margin_deg, delay_s = None, None, None
    for index, share in _crossings(log_gain):
        w = math.exp(_between(log_w, index, share))
        above_deg = (_between(phase_deg, index, share) + 180.0) % 360.0
        nearest_deg = min(above_deg, 360.0 - above_deg)
        if margin_deg is None or nearest_deg < margin_deg:
            crossover_rad_s, margin_deg = w, nearest_deg
        delay_s = min(delay_s or math.inf, math.radians(above_deg) / w)
    raise_db, lower_db = None, None
    turns = np.floor((phase_deg + 180.0) / 360.0)
    for turn in np.nonzero(np.diff(turns))[0].tolist():
        target_deg = 360.0 * max(turns[turn], turns[turn + 1]) - 180.0
        share = float((target_deg - phase_deg[turn]) / (phase_deg[turn + 1] - phase_deg[turn]))
        change_db = -20.0 / math.log(10.0) * _between(log_gain, turn, share)
        if change_db >= 0.0:
            raise_db = min(change_db, math.inf if raise_db is None else raise_db)
        else:
            lower_db = max(change_db, -math.inf if lower_db is None else lower_db)
    peak = float(np.max(1.0 / np.abs(1.0 + loop_gain)))
    return Margins(crossover_rad_s, margin_deg, raise_db, lower_db, delay_s, peak)


def _crossings(values: Array) -> list[tuple[int, float]]:
    """Where a sampled curve crosses zero: index before, and share of the way to the next sample."""
    before = np.nonzero(np.diff(np.signbit(values)))[0]
    return [(int(i), float(values[i] / (values[i] - values[i + 1]))) for i in before]


def _between(values: Array, index: int, share: float) -> float:
    return float(values[index] + share * (values[index + 1] - values[index]))


def _margins(loop: ClosedLoop) -> dict[str, Margins]:
    """Margins of each loop, cut at its command: command / injection is -L / (1 + L)."""
    response = frequency_response(loop.a, loop.b_injection, loop.c_command, OMEGA_RAD_S)
    margins = {}
    for index, name in enumerate(LOOPS):
        complementary = -response[:, index, index]
        margins[name] = margins_of(complementary / (1.0 - complementary), OMEGA_RAD_S)
    return margins


def _bandwidths(whole: ClosedLoop, inner: ClosedLoop) -> dict[str, float | None]:
    """Frequency [rad/s] above which the output stays 3 dB below its reference."""
    outer_response = frequency_response(whole.a, whole.b_reference, whole.c_output, OMEGA_RAD_S)
    inner_response = frequency_response(inner.a, inner.b_reference, inner.c_output, OMEGA_RAD_S)
    bandwidths: dict[str, float | None] = {}
    for index, name in enumerate(LOOPS):
        response = inner_response if name in ("roll", "pitch") else outer_response
        crossings = _crossings(np.log(np.abs(response[:, index, index])) + 0.5 * math.log(2.0))
        bandwidths[name] = math.exp(_between(np.log(OMEGA_RAD_S), *crossings[-1])) if crossings else None
    return bandwidths


def _steps(whole: ClosedLoop, inner: ClosedLoop) -> dict[str, StepPrediction]:
    """Predicted steps: roll and pitch of the inner loop alone, the others of the whole cascade."""
    attitude_s, position_s = STEP_SPECIFICATIONS["roll"].duration_s, STEP_SPECIFICATIONS["x"].duration_s
    responses = {
        "inner": step_responses(inner, attitude_s, STEP_SAMPLES),
        "fast": step_responses(whole, attitude_s, STEP_SAMPLES),
        "slow": step_responses(whole, position_s, STEP_SAMPLES),
    }
    source = {"roll": "inner", "pitch": "inner", "yaw": "fast", "height": "slow", "x": "slow", "y": "slow"}
    steps = {}
    for index, name in enumerate(LOOPS):
        time_s, outputs, commands = responses[source[name]]
        steps[name] = _step(STEP_SPECIFICATIONS[name], time_s, outputs[:, index, index], commands[:, index, index])
    return steps


def _step(specification: StepSpecification, time_s: Array, unit_value: Array, unit_command: Array) -> StepPrediction:
    # A diverging response is shown until it leaves any useful axis.
    diverged = np.nonzero(~(np.abs(unit_value) < DIVERGED))[0]
    shown = int(diverged[0]) if diverged.size else time_s.size
    overshoot, rise_s, settling_s = (None, None, None) if diverged.size else step_figures(time_s, unit_value)
    return StepPrediction(
        size=specification.size,
        unit=specification.unit,
        command_unit=specification.command_unit,
        time_s=tuple(time_s[:shown].tolist()),
        value=tuple((specification.size * unit_value[:shown]).tolist()),
        command=tuple((specification.size * unit_command[:shown]).tolist()),
        overshoot_percent=overshoot,
        rise_s=rise_s,
        settling_s=settling_s,
        overshoot_limit_percent=specification.overshoot_percent,
        rise_limit_s=specification.rise_s,
    )


DIVERGED = 10.0


def step_figures(time_s: Array, response: Array) -> tuple[float, float | None, float | None]:
    """Overshoot [%], rise 10-90 % [s] and settling to 2 % [s] of a unit step response that starts at 0."""
    overshoot = 100.0 * max(0.0, float(response.max()) - 1.0)
    low, high = _crossings(response - 0.1), _crossings(response - 0.9)
    rise_s = _between(time_s, *high[0]) - _between(time_s, *low[0]) if low and high else None
    outside = np.nonzero(np.abs(response - 1.0) > SETTLING_BAND)[0]
    last = int(outside[-1]) if outside.size else 0
    settling_s = float(time_s[last + 1]) if last + 1 < time_s.size else None
    return overshoot, rise_s, settling_s


def _gain_tables(law: CascadeLaw) -> dict[str, tuple[tuple[float, ...], ...]]:
    g = law.gains
    tables = {
        "attitude K": g.attitude_k,
        "attitude Kr": g.attitude_kr,
        "attitude Ki": g.attitude_ki,
        "height K": g.height_k[None, :],
        "height Kr": np.array([[g.height_kr]]),
        "height Ki": np.array([[g.height_ki]]),
        "position K": g.horizontal_k,
        "position Kr": g.horizontal_kr,
        "position Ki": g.horizontal_ki,
    }
    return {name: tuple(tuple(row) for row in table.tolist()) for name, table in tables.items()}


def _warnings(stable: bool, inner_stable: bool, loops: tuple[LoopReport, ...]) -> tuple[DesignWarning, ...]:
    found: list[DesignWarning] = []
    if not stable:
        found.append(
            DesignWarning("cascade", "stability", None, None, "Unstable: a closed-loop pole has real part >= 0.")
        )
    if not inner_stable:
        found.append(DesignWarning("attitude", "stability", None, None, "Attitude loop alone is unstable."))
    for loop in loops:
        found.extend(_loop_warnings(loop))
    return tuple(found)


def _loop_warnings(loop: LoopReport) -> list[DesignWarning]:
    name, found = loop.name.capitalize(), []
    phase, gain, delay, peak = loop.phase_margin_deg, loop.gain_margin_db, loop.delay_margin_s, loop.peak_sensitivity
    overshoot, rise, step = loop.step.overshoot_percent, loop.step.rise_s, loop.step
    if phase is not None and phase < LEAST_PHASE_MARGIN_DEG:
        text = f"{name} phase margin {phase:.1f}°, limit {LEAST_PHASE_MARGIN_DEG:.0f}°."
        found.append(DesignWarning(loop.name, "phase", phase, LEAST_PHASE_MARGIN_DEG, text))
    if gain is not None and gain < LEAST_GAIN_MARGIN_DB:
        text = f"{name} gain margin {gain:.1f} dB, limit {LEAST_GAIN_MARGIN_DB:.0f} dB."
        found.append(DesignWarning(loop.name, "gain", gain, LEAST_GAIN_MARGIN_DB, text))
    if delay is not None and delay < LEAST_DELAY_MARGIN_S:
        text = f"{name} delay margin {1e3 * delay:.0f} ms, limit {1e3 * LEAST_DELAY_MARGIN_S:.0f} ms."
        found.append(DesignWarning(loop.name, "delay", delay, LEAST_DELAY_MARGIN_S, text))
    if peak is not None and peak > GREATEST_SENSITIVITY:
        text = f"{name} peak sensitivity {peak:.2f}, limit {GREATEST_SENSITIVITY:.1f}."
        found.append(DesignWarning(loop.name, "sensitivity", peak, GREATEST_SENSITIVITY, text))
    if overshoot is not None and overshoot > step.overshoot_limit_percent:
        text = f"{name} overshoot {overshoot:.1f} %, limit {step.overshoot_limit_percent:.0f} %."
        found.append(DesignWarning(loop.name, "overshoot", overshoot, step.overshoot_limit_percent, text))
    if overshoot is not None and (rise is None or rise > step.rise_limit_s):
        took = "not reached" if rise is None else f"{rise:.2f} s"
        text = f"{name} rise {took}, limit {step.rise_limit_s:.1f} s."
        found.append(DesignWarning(loop.name, "rise", rise, step.rise_limit_s, text))
    return found
