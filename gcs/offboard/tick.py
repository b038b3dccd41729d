"""The tick: one pure function flies live, in lockstep, in replay and in every Monte Carlo.

    tick(state, inputs, t_s, *, config) -> (state, output)

Order within a tick: fold what arrived, estimate, watch link and vehicle, obey operators, check limits, steer, report.
No clock, no sleep, no random numbers; the same inputs give the same outputs to the bit.
"""

from __future__ import annotations

import hashlib
import math

import msgspec
from msgspec.structs import replace

from controllers import flight_controller
from estimators import full_state_ekf
from gcs.offboard import gain_ledger, permissions, vehicle_view
from gcs.offboard.frame import signal_frame
from gcs.offboard.limits import LAND_AFTER_S, first_breach
from gcs.offboard.modes import Event, State
from gcs.offboard.orders import obey
from gcs.offboard.state import OffboardConfig, OffboardState, Output, Turn
from gcs.offboard.steering import steer
from gcs.offboard.transitions import transition
from gcs.records import Level, TickInputs
from models.estimate import Innovation
from models.samples import AnySample, CommandAckSample, StatusTextSample
from models.setpoints import Setpoint

STALE_ESTIMATE_S = 0.1
STREAM_BEFORE_ASKING_S = 0.6
ASK_AGAIN_S = 1.0
MOST_TRIES = 4
DO_SET_MODE = 176
OFFBOARD_MODES = frozenset({"OFFBOARD", "GUIDED"})
RESULT_ACCEPTED = 0
RESULT_IN_PROGRESS = 5
# STATUSTEXT severities: emergency to error are warnings, warning is a caution, the rest is information.
WORST_ERROR, WORST_WARNING = 3, 4
_PACK = msgspec.msgpack.Encoder()


def initial(config: OffboardConfig, utc_s: float) -> OffboardState:
    """The state before the first tick: disconnected, the gain set of the vehicle file live."""
    controller = config.vehicle.controller
    name = controller.lqr_gains if controller.kind == "lqr" else controller.pid_gains
    gain_set = config.gain_sets[controller.kind, name]
    return OffboardState(
        state=State.DISCONNECTED,
        ekf=full_state_ekf.initial(config.ekf),
        law=flight_controller.prepare(gain_set, config.parameters),
        ledger=gain_ledger.opened(gain_set, name, utc_s),
    )


def tick(
    state: OffboardState, inputs: TickInputs, t_s: float, *, config: OffboardConfig
) -> tuple[OffboardState, Output]:
    """One step of the offboard controller at vehicle time ``t_s`` [s]; ``inputs`` is all that came since the last one.

    Setpoints carry the estimate of this very tick. Raises nothing: whatever is wrong is an event, an answer or silence.
    """
    turn = Turn(t_s=t_s, config=config)
    before = state.view
    state = replace(state, view=vehicle_view.fold(before, inputs.samples), t_s=t_s)
    state = _watch_link(state, inputs, turn)
    state, innovations = _estimate(state, inputs, turn)
    state = _watch_vehicle(state, inputs.samples, turn)
    state = _watch_lease(state, turn)
    for request in inputs.requests:
        state = obey(state, request, turn)
    state = _watch_limits(state, turn)
    state = _ask_for_offboard(state, turn)
    state, setpoint = steer(state, turn)
    state = replace(state, ledger=gain_ledger.steered(state.ledger, t_s, state.state is State.ACTIVE))
    return state, _output(state, inputs, innovations, setpoint, turn)


def _watch_link(state: OffboardState, inputs: TickInputs, turn: Turn) -> OffboardState:
    if inputs.overflow:
        turn.say("caution", f"{inputs.overflow} inputs dropped, more than one tick can take.", "tick")
    if inputs.rebooted:
        state = replace(state, view=vehicle_view.VehicleView())
        return transition(state, Event.REBOOT, turn)
    if inputs.link_alive:
        return transition(state, Event.LINK_UP, turn) if state.state is State.DISCONNECTED else state
    return transition(state, Event.LINK_LOST, turn)


def _estimate(state: OffboardState, inputs: TickInputs, turn: Turn) -> tuple[OffboardState, tuple[Innovation, ...]]:
    ekf, output = full_state_ekf.step(state.ekf, inputs.samples, params=turn.config.ekf)
    estimate = output.estimate if output.estimate is not None else state.estimate
    had_position = state.estimate is not None and state.estimate.position_valid
    for reset in output.resets:
        turn.say("caution" if had_position else "advisory", f"Estimator set by {reset}.", "estimator")
    state = replace(state, ekf=ekf, estimate=estimate)
    if estimate is None:
        return state, output.innovations
    if turn.t_s - estimate.time_s > STALE_ESTIMATE_S:
        state = transition(state, Event.ESTIMATE_STALE, turn)
    elif not estimate.position_valid:
        state = transition(state, Event.POSITION_LOST, turn)
    return state, output.innovations


def _watch_vehicle(state: OffboardState, samples: tuple[AnySample, ...], turn: Turn) -> OffboardState:
    for sample in samples:
        match sample:
            case StatusTextSample(severity=severity, text=text):
                turn.say(_level(severity), text, "vehicle")
            case CommandAckSample(command=command, result=result) if (
                command == DO_SET_MODE
                and state.state is State.STREAMING
                and result not in (RESULT_ACCEPTED, RESULT_IN_PROGRESS)
                and state.offboard_tries >= MOST_TRIES
            ):
                state = transition(state, Event.OFFBOARD_REFUSED, turn)
            case _:
                pass
    if state.view.heartbeat is None:
        return state
    in_offboard = state.view.mode in OFFBOARD_MODES
    if in_offboard and not math.isnan(state.offboard_asked_s):
        state = transition(state, Event.OFFBOARD_ENTERED, turn)
    if not state.view.armed:
        state = transition(state, Event.DISARMED, turn)
    elif not in_offboard and state.state is State.ACTIVE:
        state = transition(state, Event.OFFBOARD_LEFT, turn, detail=f"Mode {state.view.mode}.")
    return state


def _level(severity: int) -> Level:
    if severity <= WORST_ERROR:
        return "warning"
    return "caution" if severity <= WORST_WARNING else "advisory"


def _watch_lease(state: OffboardState, turn: Turn) -> OffboardState:
    if not permissions.expired(state.lease, turn.t_s):
        return state
    turn.say("caution", f"Controls lost: {state.lease.name} silent for 5 s.", "controls", state.lease.name)
    return replace(state, lease=permissions.Lease())


def _watch_limits(state: OffboardState, turn: Turn) -> OffboardState:
    """Hold on a breach; land when the vehicle is still beyond the limit LAND_AFTER_S later."""
    watching = not math.isnan(state.breach_since_s)
    if state.estimate is None or not (state.state is State.ACTIVE or watching):
        return state
    breach = first_breach(state.estimate, turn.config.vehicle.limits)
    if breach is None:
        return replace(state, breach_since_s=math.nan) if watching else state
    if state.state is State.ACTIVE:
        state = transition(state, Event.LIMIT_BREACHED, turn, detail=breach.text())
        return replace(state, breach_since_s=turn.t_s)
    if turn.t_s - state.breach_since_s < LAND_AFTER_S or not state.view.in_air:
        return state
    turn.say("warning", f"{breach.text()} Vehicle told to land.", "limits")
    state = transition(state, Event.LAND, turn)
    return replace(state, breach_since_s=math.nan)


def _ask_for_offboard(state: OffboardState, turn: Turn) -> OffboardState:
    """Once setpoints have flowed long enough, command OFFBOARD; ask again, then give up."""
    if state.state is not State.STREAMING or turn.t_s - state.state_since_s < STREAM_BEFORE_ASKING_S:
        return state
    asked = not math.isnan(state.offboard_asked_s)
    if asked and turn.t_s - state.offboard_asked_s < ASK_AGAIN_S:
        return state
    if state.offboard_tries >= MOST_TRIES:
        return transition(state, Event.OFFBOARD_REFUSED, turn)
    turn.modes.append("offboard")
    return replace(state, offboard_asked_s=turn.t_s, offboard_tries=state.offboard_tries + 1)


def _output(
    state: OffboardState,
    inputs: TickInputs,
    innovations: tuple[Innovation, ...],
    setpoint: Setpoint | None,
    turn: Turn,
) -> Output:
    record = state.ledger.live.record
    signals = signal_frame(
        t_s=turn.t_s,
        state=state.state,
        inputs=inputs,
        view=state.view,
        estimate=state.estimate,
        innovations=innovations,
        reference=state.reference,
        ladder=state.ladder,
        controller=record.controller,
        gain_set=record.number,
    )
    digest = hashlib.blake2b(signals.tobytes(), digest_size=8)
    digest.update(_PACK.encode((setpoint, turn.modes, turn.events, turn.answers, turn.actions)))
    return Output(
        setpoint=setpoint,
        modes=tuple(turn.modes),
        events=tuple(turn.events),
        answers=tuple(turn.answers),
        actions=tuple(turn.actions),
        signals=signals,
        hash=digest.digest(),
    )
