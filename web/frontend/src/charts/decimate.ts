// From a ring to what a chart can draw: minimum and maximum per pixel column, gaps kept as gaps.

import type { SignalRing } from "../ring";

export type Reader = (i: number) => number;

export interface Gap {
  fromS: number;
  toS: number;
}

export interface Drawn {
  x: number[];
  y: (number | null)[][];
  gaps: Gap[];
  low: number;
  high: number;
}

const GAP_PERIODS = 3;
// The hub thins ticks by the clock, so neighbours may be a few ticks apart without anything being lost.
const SHORTEST_GAP_S = 0.1;
const RATE_SAMPLES = 15;
const DENSE = 2;

function value(v: number): number | null {
  return Number.isFinite(v) ? v : null;
}

// Usual spacing at the start of the window: a backlog may be thinner than the live stream.
function usualPeriod(ring: SignalRing, first: number, last: number): number {
  const steps: number[] = [];
  for (let i = first + 1; i <= Math.min(last, first + RATE_SAMPLES); i++) steps.push(ring.at(0, i) - ring.at(0, i - 1));
  steps.sort((a, b) => a - b);
  return steps[steps.length >> 1] ?? ring.periodS;
}

class Column {
  private readonly low: number[];
  private readonly high: number[];
  private readonly lowAt: number[];
  private readonly highAt: number[];
  number = -1;

  constructor(private readonly traces: number) {
    this.low = new Array<number>(traces).fill(Infinity);
    this.high = new Array<number>(traces).fill(-Infinity);
    this.lowAt = new Array<number>(traces).fill(0);
    this.highAt = new Array<number>(traces).fill(0);
  }

  take(k: number, v: number, i: number): void {
    if (v < (this.low[k] as number)) { this.low[k] = v; this.lowAt[k] = i; }
    if (v > (this.high[k] as number)) { this.high[k] = v; this.highAt[k] = i; }
  }

  flush(drawn: Drawn, startS: number, widthS: number): void {
    if (this.number < 0) return;
    const left = startS + this.number * widthS;
    drawn.x.push(left + 0.25 * widthS, left + 0.75 * widthS);
    for (let k = 0; k < this.traces; k++) {
      const low = value(this.low[k] as number);
      const high = value(this.high[k] as number);
      const rising = (this.lowAt[k] as number) <= (this.highAt[k] as number);
      (drawn.y[k] as (number | null)[]).push(rising ? low : high, rising ? high : low);
      this.low[k] = Infinity;
      this.high[k] = -Infinity;
    }
    this.number = -1;
  }
}

// Samples of [fromS, toS] (vehicle time) for a plot `pixels` wide; x comes out relative to originS.
export function decimate(ring: SignalRing, readers: Reader[], fromS: number, toS: number, originS: number, pixels: number): Drawn {
  const drawn: Drawn = { x: [], y: readers.map(() => []), gaps: [], low: Infinity, high: -Infinity };
  const first = Math.max(0, ring.search(fromS) - 1);
  const last = Math.min(ring.count - 1, ring.search(toS));
  const widthS = (toS - fromS) / Math.max(1, pixels);
  const dense = last - first > DENSE * pixels;
  const column = new Column(readers.length);
  const startS = fromS - originS;
  let usualS = usualPeriod(ring, first, last);
  for (let i = first; i <= last; i++) {
    const t = ring.at(0, i);
    const stepS = i > first ? t - ring.at(0, i - 1) : usualS;
    if (stepS > Math.max(SHORTEST_GAP_S, GAP_PERIODS * usualS)) {
      column.flush(drawn, startS, widthS);
      drawn.gaps.push({ fromS: t - stepS - originS, toS: t - originS });
      drawn.x.push(t - stepS / 2 - originS);
      for (const y of drawn.y) y.push(null);
    } else usualS += 0.1 * (stepS - usualS);
    const at = Math.max(0, Math.floor((t - fromS) / widthS));
    if (dense && at !== column.number) {
      column.flush(drawn, startS, widthS);
      column.number = at;
    }
    if (!dense) drawn.x.push(t - originS);
    for (let k = 0; k < readers.length; k++) {
      const v = (readers[k] as Reader)(i);
      if (dense) column.take(k, v, i);
      else (drawn.y[k] as (number | null)[]).push(value(v));
      if (v < drawn.low) drawn.low = v;
      if (v > drawn.high) drawn.high = v;
    }
  }
  column.flush(drawn, startS, widthS);
  return drawn;
}
