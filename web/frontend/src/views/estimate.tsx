// Estimate: attitude, velocity, position and biases with their 3-sigma, and the normalised innovations.

import type { JSX } from "preact";
import { Chart, type ChartSpec, signal, type Trace } from "../charts/live_chart";
import type { Reader } from "../charts/decimate";
import { fixed, RAD_TO_DEG } from "../format";
import { useClock } from "../frame_loop";
import { ring } from "../ring";
import { state } from "../store";
import { ToolRow } from "./tool_row";

function bound(name: string, sigma: string, k: number, scale: number, sign: 1 | -1): () => Reader {
  return () => {
    const [value, std] = [ring.column(name, k), ring.column(sigma, k)];
    return (i) => ring.at(value, i) * scale + sign * 3 * ring.at(std, i) * Math.abs(scale);
  };
}

interface Axis {
  id: string;
  title: string;
  unit: string;
  name: string;
  sigma: string;
  other: string;
  k: number;
  scale: number;
  decimals: number;
  range: ChartSpec["range"];
}

function banded(a: Axis): ChartSpec {
  const traces: Trace[] = [
    { label: "estimate", token: "trace1", read: signal(a.name, a.k, a.scale) },
    { label: "autopilot", token: "trace2", thin: true, read: signal(a.other, a.k, a.scale) },
    { label: "+3σ", token: "trace1", thin: true, silent: true, read: bound(a.name, a.sigma, a.k, a.scale, 1) },
    { label: "−3σ", token: "trace1", thin: true, silent: true, read: bound(a.name, a.sigma, a.k, a.scale, -1) },
  ];
  return { id: `estimate-${a.id}`, title: a.title, sub: "3σ band", yLabel: `${(a.title.split(" ")[0] ?? "").toLowerCase()}, ${a.unit}`, decimals: a.decimals, range: a.range, traces, bands: [[2, 3]] };
}

const ANGLES = { kind: "about" as const, steps: [8, 16, 32, 64, 200] };
const SPEEDS = { kind: "about" as const, steps: [1, 2, 4, 8, 20] };
const PLACES = { kind: "span" as const, steps: [2, 4, 10, 20, 40, 100, 400] };

const euler = { name: "estimate.euler", sigma: "estimate.attitude_std", other: "autopilot.euler", unit: "°", scale: RAD_TO_DEG, decimals: 1 };
const velocity = { name: "estimate.velocity_ned", sigma: "estimate.velocity_std", other: "autopilot.velocity_ned", unit: "m/s", decimals: 2, range: SPEEDS };
const position = { name: "estimate.position_ned", sigma: "estimate.position_std", other: "autopilot.position_ned", unit: "m", decimals: 2, range: PLACES };

const CHARTS: ChartSpec[] = [
  ...["Roll", "Pitch", "Heading"].map((title, k) => banded({ ...euler, id: title.toLowerCase(), title, k, range: k === 2 ? { kind: "span", steps: [20, 60, 120, 400] } : ANGLES })),
  ...["Speed north", "Speed east", "Climb"].map((title, k) => banded({ ...velocity, id: `v${k}`, title, k, scale: k === 2 ? -1 : 1 })),
  ...["North", "East", "Height"].map((title, k) => banded({ ...position, id: `p${k}`, title, k, scale: k === 2 ? -1 : 1 })),
];

const LAST: ChartSpec[] = [
  {
    id: "nis", title: "NIS", sub: "per degree of freedom", yLabel: "NIS (no unit)", decimals: 2, range: { kind: "span", steps: [4, 8, 16, 64] },
    traces: [{ label: "latest", token: "trace1", read: signal("estimate.nis") }], limits: [{ value: 1, text: "expected 1", expected: true }],
  },
  {
    id: "gyro-bias", title: "Gyro bias", sub: "body", yLabel: "bias, °/s", decimals: 2, range: { kind: "about", steps: [0.5, 1, 2, 8, 20] },
    traces: ["x", "y", "z"].map((label, k) => ({ label, token: `trace${k + 1}`, read: signal("estimate.gyro_bias", k, RAD_TO_DEG) })),
  },
  {
    id: "accel-bias", title: "Accel bias", sub: "body", yLabel: "bias, m/s²", decimals: 3, range: { kind: "about", steps: [0.2, 0.5, 1, 4] },
    traces: ["x", "y", "z"].map((label, k) => ({ label, token: `trace${k + 1}`, read: signal("estimate.accel_bias", k) })),
  },
];

function Now(): JSX.Element {
  useClock(500);
  const s = state.status;
  const v = (name: string, k = 0): number => ring.value(name, k);
  const rows: [string, string, string][] = [
    ["Position 3σ, north", fixed(3 * v("estimate.position_std", 0), 2), "m"],
    ["Position 3σ, east", fixed(3 * v("estimate.position_std", 1), 2), "m"],
    ["Position 3σ, down", fixed(3 * v("estimate.position_std", 2), 2), "m"],
    ["Velocity 3σ, largest", fixed(3 * Math.max(...[0, 1, 2].map((k) => v("estimate.velocity_std", k))), 2), "m/s"],
    ["Attitude 3σ, largest", fixed(3 * RAD_TO_DEG * Math.max(...[0, 1, 2].map((k) => v("estimate.attitude_std", k))), 2), "°"],
    ["NIS, latest", fixed(v("estimate.nis"), 2), ""],
    ["Roll against autopilot", fixed((v("estimate.euler", 0) - v("autopilot.euler", 0)) * RAD_TO_DEG, 2), "°"],
    ["Pitch against autopilot", fixed((v("estimate.euler", 1) - v("autopilot.euler", 1)) * RAD_TO_DEG, 2), "°"],
  ];
  return (
    <section class="panel" data-testid="estimate-now">
      <header class="head"><h2>Now</h2><span class="right">{s?.position_source && `position from ${s.position_source}`}</span></header>
      <p class="statement">{s?.estimator || "No estimate"}</p>
      <table class="grid-table"><tbody>{rows.map(([name, value, unit]) => (
        <tr key={name}><td>{name}</td><td class="strong">{value}</td><td class="unit-cell">{unit}</td></tr>))}</tbody></table>
    </section>
  );
}

export function EstimateView(): JSX.Element {
  return (
    <div class="estimate">
      <ToolRow />
      <div class="charts">{[...CHARTS, ...LAST].map((spec) => <Chart key={spec.id} spec={spec} />)}</div>
      <div class="side"><Now /></div>
    </div>
  );
}
