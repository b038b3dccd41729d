// The six charts of the Fly view.

import { type ChartSpec, difference, signal, type Trace } from "../charts/live_chart";
import { RAD_TO_DEG } from "../format";

const ANGLE = { kind: "about" as const, steps: [8, 16, 32, 64, 180] };

function angle(id: string, title: string, k: number): ChartSpec {
  return {
    id, title, yLabel: `${title.toLowerCase()}, °`, decimals: 1, range: ANGLE, namesGap: k === 0,
    traces: [
      { label: "setpoint", token: "reference", dash: true, read: signal("control.euler_command", k, RAD_TO_DEG) },
      { label: "estimate", token: "trace1", read: signal("estimate.euler", k, RAD_TO_DEG) },
    ],
  };
}

function four(names: string[], read: (k: number) => Trace["read"]): Trace[] {
  return names.map((label, k) => ({ label, token: `trace${k + 1}`, read: read(k) }));
}

export const FLY_CHARTS: ChartSpec[] = [
  angle("roll", "Roll", 0),
  angle("pitch", "Pitch", 1),
  {
    id: "position-error", title: "Position error", sub: "NED", yLabel: "error, m", decimals: 2, range: { kind: "about", steps: [0.4, 0.8, 1.6, 4, 8, 20, 100] },
    traces: four(["N", "E", "D"], (k) => difference("estimate.position_ned", "reference.position_ned", k)),
  },
  {
    id: "rates", title: "Body rates", yLabel: "rate, °/s", decimals: 1, range: { kind: "about", steps: [20, 40, 80, 160, 320, 720] },
    traces: four(["p", "q", "r"], (k) => signal("estimate.rates_body", k, RAD_TO_DEG)),
  },
  {
    id: "height", title: "Height", sub: "above home", yLabel: "height, m", decimals: 2, range: { kind: "span", steps: [0.4, 1, 2, 4, 10, 20, 40, 100] },
    traces: [
      { label: "setpoint", token: "reference", dash: true, read: signal("reference.position_ned", 2, -1) },
      { label: "estimate", token: "trace1", read: signal("estimate.position_ned", 2, -1) },
    ],
  },
  {
    id: "actuators", title: "Rotors", yLabel: "output, %", decimals: 0, range: { kind: "span", steps: [20, 40, 100, 200] },
    traces: four(["M1", "M2", "M3", "M4"], (k) => signal("actuator.outputs", k, 100)),
  },
];
