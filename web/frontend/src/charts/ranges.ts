// Axis ranges: fixed per quantity, widening in steps, shrinking only on request. A moving axis hides motion.

export interface RangeSpec {
  // Half-widths about zero ("about": 0), or whole spans laid on a grid of a quarter span ("span").
  kind: "about" | "span" | "fixed";
  steps: number[];
  low?: number;
}

export class StepRange {
  low = 0;
  high = 1;
  private step = 0;
  private set = false;

  constructor(private readonly spec: RangeSpec) {
    this.reset();
  }

  reset(): void {
    this.step = 0;
    this.set = false;
    const size = this.size();
    if (this.spec.kind === "about") [this.low, this.high] = [-size, size];
    else [this.low, this.high] = [this.spec.low ?? 0, (this.spec.low ?? 0) + size];
  }

  private size(): number {
    return this.spec.steps[Math.min(this.step, this.spec.steps.length - 1)] as number;
  }

  private get last(): boolean {
    return this.step >= this.spec.steps.length - 1;
  }

  // Makes room for data between low and high; leaves the axis alone while they fit.
  fit(low: number, high: number): void {
    if (!Number.isFinite(low) || !Number.isFinite(high) || this.spec.kind === "fixed") return;
    if (this.set && low >= this.low && high <= this.high) return;
    if (this.spec.kind === "about") {
      while (!this.last && Math.max(-low, high) > this.size()) this.step += 1;
      const size = Math.max(this.size(), this.last ? Math.max(-low, high) : 0);
      [this.low, this.high] = [-size, size];
    } else this.fitSpan(Math.min(low, this.set ? this.low : low), Math.max(high, this.set ? this.high : high));
    this.set = true;
  }

  private fitSpan(low: number, high: number): void {
    for (; ; this.step += 1) {
      const span = this.last ? Math.max(this.size(), 1.5 * (high - low)) : this.size();
      const grid = span / 4;
      const floor = Math.floor(low / grid) * grid;
      if (floor + span >= high || this.last) {
        this.low = floor;
        this.high = floor + span;
        return;
      }
    }
  }
}
