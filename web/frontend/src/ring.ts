// The last minutes of every signal, column by column in typed arrays. One writer (the stream), many readers (painters).

import type { SignalRow } from "./protocol";

const CAPACITY = 1 << 14;
const JUMP_BACK_S = 1;
const PERIOD_SAMPLES = 32;

export class SignalRing {
  private columns: Float64Array[] = [];
  private index = new Map<string, SignalRow>();
  private inertial: number[] = [];
  private frameSize = 0;
  private start = 0;
  count = 0;
  version = 0;
  arrivedMs = 0;
  periodS = 0.02;

  layout(signals: SignalRow[], frameSize: number): void {
    this.index = new Map(signals.map((row) => [row.name, row]));
    this.frameSize = frameSize;
    this.inertial = ["imu.gyro_body", "imu.accel_body"].flatMap((name) => [0, 1, 2].map((k) => this.column(name, k))).filter((c) => c >= 0);
    this.columns = Array.from({ length: frameSize }, () => new Float64Array(CAPACITY));
    this.clear();
  }

  clear(): void {
    this.start = 0;
    this.count = 0;
    this.version += 1;
  }

  // Appends whole frames; a stamp that jumps back is a reboot of the vehicle and begins anew, small overlaps are dropped.
  append(values: Float64Array, nowMs: number): void {
    if (this.frameSize === 0) return;
    for (let base = 0; base + this.frameSize <= values.length; base += this.frameSize) {
      const t = values[base] as number;
      if (this.count > 0) {
        const last = this.newest(0);
        if (t < last - JUMP_BACK_S) this.clear();
        else if (!(t > last) || this.repeats(values, base)) continue;
      }
      this.push(values, base);
      this.arrivedMs = nowMs;
    }
    this.version += 1;
    this.measurePeriod();
  }

  // The flight process also ticks by its watchdog while the vehicle is silent. Such a frame holds the last inertial
  // sample, bit for bit; it tells nothing new of the vehicle and must not be drawn as if it did.
  private repeats(values: Float64Array, base: number): boolean {
    if (this.inertial.length === 0) return false;
    return this.inertial.every((column) => values[base + column] === this.newest(column));
  }

  private push(values: Float64Array, base: number): void {
    const at = (this.start + this.count) % CAPACITY;
    for (let c = 0; c < this.frameSize; c++) (this.columns[c] as Float64Array)[at] = values[base + c] as number;
    if (this.count < CAPACITY) this.count += 1;
    else this.start = (this.start + 1) % CAPACITY;
  }

  private measurePeriod(): void {
    const samples = Math.min(PERIOD_SAMPLES, this.count - 1);
    if (samples < 8) return;
    const steps: number[] = [];
    for (let i = this.count - samples; i < this.count; i++) steps.push(this.at(0, i) - this.at(0, i - 1));
    steps.sort((a, b) => a - b);
    this.periodS = Math.max(0.002, steps[samples >> 1] as number);
  }

  column(name: string, component = 0): number {
    const row = this.index.get(name);
    return row && component < row.size ? row.offset + component : -1;
  }

  at(column: number, i: number): number {
    if (column < 0 || i < 0 || i >= this.count) return NaN;
    return (this.columns[column] as Float64Array)[(this.start + i) % CAPACITY] as number;
  }

  newest(column: number): number {
    return this.at(column, this.count - 1);
  }

  value(name: string, component = 0): number {
    return this.newest(this.column(name, component));
  }

  get newestTimeS(): number {
    return this.newest(0);
  }

  // First index whose time is >= t.
  search(t: number): number {
    let low = 0;
    let high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.at(0, middle) < t) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  // Index of the sample on or before t, -1 if none.
  before(t: number): number {
    const i = this.search(t);
    return i < this.count && this.at(0, i) === t ? i : i - 1;
  }
}

export const ring = new SignalRing();

// Seconds since the last sample of vehicle data reached this page.
export function sampleAgeS(nowMs: number): number {
  return ring.count === 0 ? Infinity : (nowMs - ring.arrivedMs) / 1000;
}

// Older than three periods, at least .25 s.
export function isStale(nowMs: number): boolean {
  return sampleAgeS(nowMs) > Math.max(0.25, 3 * ring.periodS);
}
