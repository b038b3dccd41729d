// A chart of finished curves (predictions, a flown step): redrawn when its data change, not by the clock.

import type { JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { fixed } from "../format";
import { colour } from "../theme";
import { axes } from "./dressing";
import { type RangeSpec, StepRange } from "./ranges";

export interface Curve {
  label: string;
  token: string;
  dash?: boolean;
  x: number[];
  y: number[];
}

interface Props {
  testid: string;
  title: string;
  sub: string;
  yLabel: string;
  decimals: number;
  curves: Curve[];
  x: [number, number];
  range: RangeSpec;
  // Curves of equal group share one cursor.
  sync: string;
}

// All curves on one time axis: each has its own samples, null elsewhere; uPlot joins across its own nulls.
function aligned(curves: Curve[]): uPlot.AlignedData {
  return uPlot.join(curves.map((curve) => [curve.x, curve.y] as uPlot.AlignedData));
}

function valueAt(curve: Curve, x: number): number {
  let i = curve.x.findIndex((t) => t >= x);
  if (i < 0) i = curve.x.length - 1;
  if (i === 0 || x > (curve.x[curve.x.length - 1] ?? -Infinity) + 1e-9) return i === 0 ? (curve.y[0] ?? NaN) : NaN;
  const [x0, x1] = [curve.x[i - 1] as number, curve.x[i] as number];
  const share = x1 > x0 ? (x - x0) / (x1 - x0) : 1;
  return (curve.y[i - 1] as number) + share * ((curve.y[i] as number) - (curve.y[i - 1] as number));
}

class Drawing {
  private readonly plot: uPlot;
  private readonly range: StepRange;

  constructor(private props: Props, private readonly body: HTMLElement, private readonly head: HTMLElement) {
    this.range = new StepRange(props.range);
    this.plot = new uPlot(this.options(), [[], ...props.curves.map(() => [])] as uPlot.AlignedData, body);
    this.show(props);
  }

  destroy(): void {
    this.plot.destroy();
  }

  resize(): void {
    if (this.body.clientWidth > 0 && this.body.clientHeight > 0) this.plot.setSize({ width: this.body.clientWidth, height: this.body.clientHeight });
  }

  private options(): uPlot.Options {
    return {
      width: Math.max(60, this.body.clientWidth), height: Math.max(40, this.body.clientHeight), legend: { show: false }, padding: [6, 12, 0, 0],
      scales: { x: { time: false, range: () => this.props.x }, y: { range: () => [this.range.low, this.range.high] } },
      axes: axes(this.props.yLabel, "s", () => this.range),
      series: [{}, ...this.props.curves.map((curve) => ({
        label: curve.label, stroke: () => colour(curve.token), width: 1.5, points: { show: false }, spanGaps: true, ...(curve.dash ? { dash: [4, 4] } : {}),
      }))],
      cursor: { x: true, y: false, points: { show: false }, sync: { key: this.props.sync }, drag: { x: false, y: false, setScale: false } },
      hooks: { setCursor: [() => this.write()] },
    };
  }

  show(props: Props): void {
    this.props = props;
    const values = props.curves.flatMap((curve) => curve.y.filter((_v, i) => (curve.x[i] as number) <= props.x[1]));
    this.range.reset();
    this.range.fit(Math.min(...values), Math.max(...values));
    if (props.curves.length > 0) this.plot.setData(aligned(props.curves));
    this.write();
  }

  private write(): void {
    const left = this.plot.cursor.left ?? -1;
    const x = left >= 0 ? this.plot.posToVal(left, "x") : null;
    this.head.querySelectorAll<HTMLElement>("[data-curve]").forEach((cell) => {
      const curve = this.props.curves[Number(cell.dataset.curve)];
      cell.textContent = curve && x !== null ? fixed(valueAt(curve, x), this.props.decimals) : "";
    });
    const time = this.head.querySelector<HTMLElement>("[data-cursor]");
    if (time) time.textContent = x === null ? this.props.sub : `at ${fixed(x, 2)} s`;
  }
}

export function PlainChart(props: Props): JSX.Element {
  const head = useRef<HTMLElement>(null);
  const body = useRef<HTMLDivElement>(null);
  const drawing = useRef<Drawing | null>(null);
  useEffect(() => {
    if (!head.current || !body.current) return undefined;
    const made = new Drawing(props, body.current, head.current);
    drawing.current = made;
    const observer = new ResizeObserver(() => made.resize());
    observer.observe(body.current);
    return () => {
      observer.disconnect();
      made.destroy();
    };
    // uPlot is made anew when the set of curves changes; new data alone are only drawn.
  }, [props.yLabel, props.sync, props.curves.map((curve) => curve.label).join()]);
  useEffect(() => drawing.current?.show(props), [props.curves]);
  return (
    <section class="panel chart plain" data-testid={props.testid} aria-label={`${props.title}, ${props.yLabel}`}>
      <header class="head" ref={head}>
        <h2>{props.title}</h2>
        <span class="sub" data-cursor data-named>{props.sub}</span>
        <span class="legend">
          {props.curves.map((curve, k) => (
            <span class="entry" key={curve.label}><i class={`swatch c-${curve.token}${curve.dash ? " dash" : ""}`} /><span class="name">{curve.label}</span><b data-curve={k} /></span>
          ))}
        </span>
      </header>
      <div class="plot" ref={body} />
    </section>
  );
}
