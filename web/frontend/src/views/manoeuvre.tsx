// From the ground to a manoeuvre and back: arm, take off, offboard, trajectory, controller.

import type { JSX } from "preact";
import { useState } from "preact/hooks";
import { send } from "../api";
import { Key, Segments } from "../controls";
import { fixed, minutes } from "../format";
import { useClock } from "../frame_loop";
import type { Command, ControllerKind } from "../protocol";
import { ring } from "../ring";
import { airborne, flying, holdsControls, type State, state, useStore } from "../store";
import { TrajectoryForm } from "./trajectory_form";

const RMS_S = 10;

function positionRms(): number {
  const columns = [0, 1, 2].map((k) => [ring.column("estimate.position_ned", k), ring.column("reference.position_ned", k)] as const);
  let [sum, n] = [0, 0];
  for (let i = ring.search(ring.newestTimeS - RMS_S); i < ring.count; i++) {
    const square = columns.reduce((s, [a, b]) => s + (ring.at(a, i) - ring.at(b, i)) ** 2, 0);
    if (!Number.isFinite(square)) continue;
    sum += square;
    n += 1;
  }
  return n > 0 ? Math.sqrt(sum / n) : NaN;
}

function Figure({ label, value, unit = "" }: { label: string; value: string; unit?: string }): JSX.Element {
  return <div class="figure"><span class="label">{label}</span><b>{value}</b>{unit && <span class="unit">{unit}</span>}</div>;
}

export function ManoeuvreProgress(): JSX.Element {
  useClock(250);
  const trajectory = state.status?.trajectory;
  const progress = trajectory?.progress ?? null;
  const lap = trajectory?.lap ?? null;
  const left = trajectory?.left_s ?? null;
  return (
    <div class="progress-block" data-testid="manoeuvre-progress">
      <p class="flying" data-testid="manoeuvre-description">{trajectory?.description || "No trajectory"}</p>
      <div class="figures">
        <Figure label="Lap" value={lap === null ? "–" : String(lap)} />
        <Figure label={`Error RMS, ${RMS_S} s`} value={fixed(positionRms(), 2)} unit="m" />
        <Figure label="Done" value={progress === null ? "endless" : fixed(progress * 100, 0)} unit={progress === null ? "" : "%"} />
        <Figure label="Left" value={left === null ? "–" : left < 100 ? fixed(left, 0) : minutes(left)} unit={left !== null && left < 100 ? "s" : ""} />
      </div>
      <svg class="progress" width="100%" height="3" aria-hidden="true"><rect class="track" width="100%" height="3" /><rect class="done" width={`${(progress ?? 0) * 100}%`} height="3" /></svg>
    </div>
  );
}

interface Check {
  name: string;
  good: boolean;
  text: string;
}

function checks(s: State): Check[] {
  const status = s.status;
  if (!status) return [{ name: "Vehicle", good: false, text: "none seen" }];
  const sigma = 3 * Math.hypot(ring.value("estimate.position_std", 0), ring.value("estimate.position_std", 1));
  const holder = status.controls_holder;
  const charge = status.battery_remaining;
  return [
    { name: "Link", good: status.link_state === "live", text: status.link_state === "live" ? `${fixed(ring.value("link.received") * 100, 1)} %` : status.link_state },
    { name: "Position 3σ", good: sigma < 5, text: Number.isFinite(sigma) ? `${fixed(sigma, 2)} m` : "no estimate" },
    { name: "Controls", good: holdsControls(s), text: holdsControls(s) ? "yours" : holder ? `with ${holder}` : "free, take them" },
    { name: "Battery", good: charge !== null && charge > 0.3, text: charge === null ? "unknown" : `${fixed(charge * 100, 0)} %` },
  ];
}

function Checklist(): JSX.Element {
  useClock(500);
  return (
    <dl class="checklist" data-testid="checklist">
      {checks(state).map((check) => (
        <div key={check.name} class={check.good ? "" : "open"}><dt>{check.name}</dt><dd>{check.text}</dd></div>
      ))}
    </dl>
  );
}

export function ControllerSwitch({ onRefused }: { onRefused: (reason: string) => void }): JSX.Element {
  const kind = useStore((s) => s.status?.controller ?? null);
  const mine = useStore(holdsControls);
  const inAir = useStore(airborne);
  const pick = (controller: ControllerKind): void => {
    void send({ type: "select_controller", controller, why: "Chosen on the dashboard" }).then((answer) => onRefused(answer.accepted ? "" : answer.reason));
  };
  return (
    <Segments testid="controller" label="Controller" hold={inAir} disabled={!mine} value={kind}
      options={[{ value: "lqr", text: "LQR+I" }, { value: "pid", text: "PI" }]} onPick={pick} />
  );
}

const HEIGHT = { minimum: 0.5, maximum: 100 };

function FlightKeys({ give }: { give: (command: Command) => void }): JSX.Element {
  const [height, setHeight] = useState("2.5");
  const mine = useStore(holdsControls);
  const armed = useStore((s) => s.status?.armed ?? false);
  const inAir = useStore(airborne);
  const offboard = useStore(flying);
  const height_m = Number(height);
  const good = height_m >= HEIGHT.minimum && height_m <= HEIGHT.maximum;
  return (
    <div class="keys">
      <Key testid="arm" disabled={!mine || inAir} onAct={() => give({ type: armed ? "disarm" : "arm" })}>{armed ? "Disarm" : "Arm"}</Key>
      <Key testid="take-off" disabled={!mine || inAir || !good} onAct={() => give({ type: "take_off", height_m })}>Take off</Key>
      <label class="with-unit"><span class="unseen">Take-off height</span>
        <input class="field short" data-testid="take-off-height" value={height} disabled={!mine || inAir} aria-invalid={!good} inputMode="decimal"
          onInput={(e) => setHeight(e.currentTarget.value)} /><span class="unit">m</span></label>
      {offboard
        ? <Key testid="stop-and-hold" disabled={!mine} onAct={() => give({ type: "fly_trajectory", trajectory: { kind: "hover" } })}>Stop and hold</Key>
        : <Key testid="start-offboard" disabled={!mine || !inAir} onAct={() => give({ type: "start_offboard" })}>Start offboard</Key>}
    </div>
  );
}

export function ManoeuvreBody(): JSX.Element {
  const [refused, setRefused] = useState("");
  const armed = useStore((s) => s.status?.armed ?? false);
  const observer = useStore((s) => s.session?.role === "observer");
  const mine = useStore(holdsControls);
  const give = (command: Command): void => {
    void send(command).then((answer) => setRefused(answer.accepted ? "" : answer.reason));
  };
  return (
    <div class="scroll manoeuvre-body">
      {armed ? <ManoeuvreProgress /> : <Checklist />}
      <FlightKeys give={give} />
      <TrajectoryForm give={give} say={setRefused} />
      {refused ? <p class="refusal" role="status" data-testid="manoeuvre-refusal">{refused}</p>
        : !mine && <p class="hint">{observer ? "Observers watch. Log in as operator to fly." : "Take controls (C) to fly."}</p>}
    </div>
  );
}
