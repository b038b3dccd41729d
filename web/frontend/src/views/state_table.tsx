// Setpoint, estimate, error and 3-sigma of what is being flown.

import type { JSX } from "preact";
import { fixed, NONE, RAD_TO_DEG, signed } from "../format";
import { useClock } from "../frame_loop";
import { isStale, ring, sampleAgeS } from "../ring";
import { state } from "../store";

interface Row {
  name: string;
  setpoint: [string, number];
  estimate: [string, number];
  sigma: [string, number];
  scale: number;
  unit: string;
  decimals: number;
  wraps?: boolean;
}

const POSITION = { sigmaName: "estimate.position_std", unit: "m", decimals: 2 };

function row(name: string, set: string, est: string, sig: string, k: number, scale: number, unit: string, decimals: number): Row {
  return { name, setpoint: [set, k], estimate: [est, k], sigma: [sig, k], scale, unit, decimals };
}

const ROWS: Row[] = [
  ...(["North", "East", "Height"] as const).map((name, k) =>
    row(name, "reference.position_ned", "estimate.position_ned", POSITION.sigmaName, k, k === 2 ? -1 : 1, POSITION.unit, POSITION.decimals)),
  ...(["Speed north", "Speed east", "Climb"] as const).map((name, k) =>
    row(name, "reference.velocity_ned", "estimate.velocity_ned", "estimate.velocity_std", k, k === 2 ? -1 : 1, "m/s", 2)),
  ...(["Roll", "Pitch"] as const).map((name, k) =>
    row(name, "control.euler_command", "estimate.euler", "estimate.attitude_std", k, RAD_TO_DEG, "°", 1)),
  {
    name: "Heading", setpoint: ["reference.yaw", 0], estimate: ["estimate.euler", 2], sigma: ["estimate.attitude_std", 2],
    scale: RAD_TO_DEG, unit: "°", decimals: 1, wraps: true,
  },
];

const DROP_S = 5;

export function StateTable(): JSX.Element {
  const now = useClock(125);
  const stale = isStale(now);
  const ageS = sampleAgeS(now);
  return (
    <section class="panel state" data-testid="state-table">
      <header class="head">
        <h2>State</h2>
        <span class="right">
          {stale && ring.count > 0 ? `${ageS.toFixed(1)} s old` : `${state.status?.estimator || "no estimate"}, ${fixed(1 / ring.periodS, 0)} Hz`}
        </span>
      </header>
      <div class="scroll">
        <table class="grid-table">
          <thead><tr><th>Quantity</th><th>Setpoint</th><th>Estimate</th><th>Error</th><th>3σ</th><th class="left">Unit</th></tr></thead>
          <tbody>{ROWS.map((entry) => <StateRow key={entry.name} entry={entry} stale={stale} ageS={ageS} />)}</tbody>
        </table>
      </div>
    </section>
  );
}

function StateRow({ entry, stale, ageS }: { entry: Row; stale: boolean; ageS: number }): JSX.Element {
  const setpoint = ring.value(...entry.setpoint) * entry.scale;
  const estimate = ring.value(...entry.estimate) * entry.scale;
  const sigma = ring.value(...entry.sigma) * Math.abs(entry.scale) * 3;
  let error = estimate - setpoint;
  if (entry.wraps) error = ((error + 540) % 360) - 180;
  const tone = stale ? "stale" : "strong";
  const id = entry.name.toLowerCase().replace(" ", "-");
  return (
    <tr data-testid={`state-${id}`}>
      <td>{entry.name}</td>
      <td class={stale ? "stale" : ""}>{fixed(setpoint, entry.decimals)}</td>
      <td class={tone} data-testid={`state-${id}-estimate`}>{fixed(estimate, entry.decimals)}</td>
      <td class={tone}>{ageS > DROP_S ? NONE : signed(error, entry.decimals)}</td>
      <td class={stale ? "stale" : ""}>{fixed(sigma, entry.decimals)}</td>
      <td class="unit-cell">{entry.unit}</td>
    </tr>
  );
}
