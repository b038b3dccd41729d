// A step that was really flown, cut out of the ring: a jump of the reference, and what the estimate did after it.

import { ring } from "./ring";

export interface FlownStep {
  size: number;
  startS: number;
  time_s: number[];
  value: number[];
  overshoot_percent: number | null;
  rise_s: number | null;
  settling_s: number | null;
}

interface Source {
  reference: [string, number];
  estimate: [string, number];
  scale: number;
  smallest: number;
}

const SOURCES: Record<string, Source> = {
  yaw: { reference: ["reference.yaw", 0], estimate: ["estimate.euler", 2], scale: 1, smallest: 0.03 },
  height: { reference: ["reference.position_ned", 2], estimate: ["estimate.position_ned", 2], scale: -1, smallest: 0.1 },
  x: { reference: ["reference.position_ned", 0], estimate: ["estimate.position_ned", 0], scale: 1, smallest: 0.1 },
  y: { reference: ["reference.position_ned", 1], estimate: ["estimate.position_ned", 1], scale: 1, smallest: 0.1 },
};

const QUIET_SAMPLES = 10;
const SETTLING_BAND = 0.02;
const LEAST_S = 1;

export function canFly(loop: string): boolean {
  return loop in SOURCES;
}

// The newest jump of the reference that came after a while of rest.
function newestJump(column: number, smallest: number): number {
  for (let i = ring.count - 1; i > QUIET_SAMPLES; i--) {
    const before = ring.at(column, i - 1);
    if (Math.abs(ring.at(column, i) - before) < smallest) continue;
    if (Math.abs(ring.at(column, i - QUIET_SAMPLES) - before) < smallest / 10) return i;
  }
  return -1;
}

function measures(time: number[], value: number[], size: number): Pick<FlownStep, "overshoot_percent" | "rise_s" | "settling_s"> {
  const reach = (share: number): number | null => time[value.findIndex((v) => v / size >= share)] ?? null;
  const [low, high] = [reach(0.1), reach(0.9)];
  const peak = Math.max(...value.map((v) => v / size));
  let settled: number | null = null;
  for (let i = value.length - 1; i >= 0 && Math.abs((value[i] as number) / size - 1) <= SETTLING_BAND; i--) settled = time[i] as number;
  return {
    overshoot_percent: high === null ? null : Math.max(0, (peak - 1) * 100),
    rise_s: low === null || high === null ? null : high - low,
    settling_s: settled,
  };
}

// Scaled to the size of the prediction, so that both share axes, start and amplitude. Null when none was flown.
export function flownStep(loop: string, size: number, durationS: number): FlownStep | null {
  const source = SOURCES[loop];
  if (!source || ring.count === 0) return null;
  const reference = ring.column(...source.reference);
  const estimate = ring.column(...source.estimate);
  const jump = newestJump(reference, source.smallest);
  if (jump < 0) return null;
  const startS = ring.at(0, jump);
  const target = ring.at(reference, jump);
  const flown = (target - ring.at(reference, jump - 1)) * source.scale;
  const origin = ring.at(estimate, jump);
  const [time, value]: [number[], number[]] = [[], []];
  for (let i = jump; i < ring.count && ring.at(0, i) - startS <= durationS; i++) {
    if (Math.abs(ring.at(reference, i) - target) > source.smallest / 10) break;
    time.push(ring.at(0, i) - startS);
    value.push(((ring.at(estimate, i) - origin) * source.scale * size) / flown);
  }
  if ((time[time.length - 1] ?? 0) < LEAST_S) return null;
  return { size: flown, startS, time_s: time, value, ...measures(time, value, size) };
}

// RMS difference between what was flown and the model, over the time both cover.
export function rmsFromModel(flown: FlownStep, time: number[], value: number[]): number {
  let [sum, n] = [0, 0];
  let k = 0;
  flown.time_s.forEach((t, i) => {
    while (k < time.length - 2 && (time[k + 1] as number) < t) k += 1;
    const [t0, t1] = [time[k] as number, time[k + 1] as number];
    if (t > t1) return;
    const model = (value[k] as number) + (((value[k + 1] as number) - (value[k] as number)) * (t - t0)) / (t1 - t0);
    sum += ((flown.value[i] as number) - model) ** 2;
    n += 1;
  });
  return n > 0 ? Math.sqrt(sum / n) : NaN;
}
