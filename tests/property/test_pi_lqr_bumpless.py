"""The one rule of switching: right after any change of controller or gains the command is the last one, exactly."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from controllers import flight_controller
from controllers.cascade import CascadeLimits, Command
from controllers.gains import edited, load_gain_set, table_of
from models.estimate import Reference
from models.parameters import load_quadrotor
from tests.unit.test_pi_cascade import estimate_at

PARAMETERS = load_quadrotor()
SETS = [load_gain_set(kind, name) for kind in ("lqr", "pid") for name in ("default", "published")]
LAWS = [flight_controller.prepare(gain_set, PARAMETERS) for gain_set in SETS]


def triple(limit: float):
    return st.tuples(*[st.floats(-limit, limit) for _ in range(3)])


estimates = st.builds(
    estimate_at,
    position=triple(100.0),
    velocity=triple(8.0),
    euler=st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(-3.1, 3.1)),
    rates=triple(3.0),
)
references = st.builds(
    Reference,
    position_ned_m=triple(100.0),
    velocity_ned_m_s=triple(3.0),
    acceleration_ned_m_s2=triple(2.0),
    jerk_ned_m_s3=triple(2.0),
    yaw_rad=st.floats(-3.1, 3.1),
    yaw_rate_rad_s=st.floats(-0.5, 0.5),
)
commands = st.builds(
    Command,
    tilt_rad=st.tuples(st.floats(-0.24, 0.24), st.floats(-0.24, 0.24)),
    thrust_n=st.floats(2.0, 26.0),
    torque_n_m=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-0.2, 0.2)),
)


@st.composite
def changed_sets(draw):
    base = draw(st.sampled_from(SETS))
    entries = draw(st.lists(st.sampled_from(table_of("lqr" if base is SETS[0] or base is SETS[1] else "pid"))))
    share = st.floats(0.0, 0.05)
    changes = {
        entry.key: entry.minimum + draw(share) * (entry.maximum - entry.minimum)
        for entry in entries
        if entry.key != "feed_forward"
    }
    return edited(base, changes)


def assert_same_command(state, estimate, reference, last: Command) -> None:
    after, _ = flight_controller.step(state, estimate, reference, limits=CascadeLimits())
    command = after.cascade.command
    assert max(abs(a - b) for a, b in zip(command.tilt_rad, last.tilt_rad, strict=True)) < 1e-9
    assert abs(command.thrust_n - last.thrust_n) < 1e-8
    assert max(abs(a - b) for a, b in zip(command.torque_n_m, last.torque_n_m, strict=True)) < 1e-8


@given(estimate=estimates, reference=references, last=commands, law=st.sampled_from(LAWS))
@settings(max_examples=150, deadline=None)
def test_engaging_continues_the_last_command(estimate, reference, last, law) -> None:
    state = flight_controller.engage(law, estimate, reference, gain_set_number=1, last=last)
    assert_same_command(state, estimate, reference, last)


@given(estimate=estimates, reference=references, last=commands, first=st.sampled_from(LAWS), second=changed_sets())
@settings(max_examples=60, deadline=None)
def test_any_gain_change_and_any_switch_continue_the_last_command(estimate, reference, last, first, second) -> None:
    state = flight_controller.engage(first, estimate, reference, gain_set_number=1, last=last)
    state, _ = flight_controller.step(state, estimate, reference, limits=CascadeLimits())
    before = state.cascade.command
    law = flight_controller.prepare(second, PARAMETERS)
    state = flight_controller.switch_to(state, law, estimate, reference, gain_set_number=2)
    assert state.gain_set_number == 2
    assert_same_command(state, estimate, reference, before)
