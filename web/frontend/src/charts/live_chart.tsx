// One live chart: head with title and newest values, uPlot below. Draws from the ring, on the page's one frame.

import type { JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { fixed } from "../format";
import { onFrame } from "../frame_loop";
import { isStale, ring } from "../ring";
import { state, update } from "../store";
import { colour, themeVersion } from "../theme";
import { cursorTime, setCursorTime } from "./cursor";
import { decimate, type Drawn, type Reader } from "./decimate";
import { axes, gapPainter, type Limit, limitPainter } from "./dressing";
import { type RangeSpec, StepRange } from "./ranges";
import { liveTimeS } from "./clock";

export interface Trace {
  label: string;
  token: string;
  dash?: boolean;
  thin?: boolean;
  silent?: boolean;
  read: () => Reader;
}

export interface ChartSpec {
  id: string;
  title: string;
  sub?: string;
  yLabel: string;
  decimals: number;
  range: RangeSpec;
  traces: Trace[];
  bands?: [number, number][];
  limits?: Limit[];
  namesGap?: boolean;
}

const DRAW_MS = 50;

export function signal(name: string, component = 0, scale = 1): () => Reader {
  return () => {
    const column = ring.column(name, component);
    return (i) => ring.at(column, i) * scale;
  };
}

export function difference(a: string, b: string, component: number, scale = 1): () => Reader {
  return () => {
    const [left, right] = [ring.column(a, component), ring.column(b, component)];
    return (i) => (ring.at(left, i) - ring.at(right, i)) * scale;
  };
}

class LiveChart {
  private readonly plot: uPlot;
  private readonly range: StepRange;
  private drawn: Drawn = { x: [], y: [], gaps: [], low: 0, high: 0 };
  private window: [number, number] = [-30, 0];
  private seen = "";

  constructor(private readonly spec: ChartSpec, private readonly body: HTMLElement, private readonly head: HTMLElement) {
    this.range = new StepRange(spec.range);
    this.plot = new uPlot(this.options(), [[], ...spec.traces.map(() => [])] as uPlot.AlignedData, body);
  }

  destroy(): void {
    this.plot.destroy();
  }

  resetRange(): void {
    this.range.reset();
    this.seen = "";
  }

  resize(): void {
    const { clientWidth, clientHeight } = this.body;
    if (clientWidth > 0 && clientHeight > 0) this.plot.setSize({ width: clientWidth, height: clientHeight });
  }

  private options(): uPlot.Options {
    const spec = this.spec;
    return {
      width: Math.max(60, this.body.clientWidth),
      height: Math.max(40, this.body.clientHeight),
      legend: { show: false },
      padding: [6, 10, 0, 0],
      scales: { x: { time: false, range: () => this.window }, y: { range: () => [this.range.low, this.range.high] } },
      axes: axes(spec.yLabel, "s", () => this.range),
      series: [{}, ...spec.traces.map((trace) => ({
        label: trace.label, stroke: () => colour(trace.token), width: trace.thin ? 0.75 : 1.5, points: { show: false }, spanGaps: false,
        ...(trace.dash ? { dash: [4, 4] } : {}),
      }))],
      bands: (spec.bands ?? []).map(([high, low]) => ({ series: [high + 1, low + 1] as [number, number], fill: () => bandColour(spec.traces[high]?.token ?? "trace1") })),
      cursor: {
        x: true, y: false, points: { show: false }, sync: { key: "live" }, drag: { x: true, y: false, setScale: false, dist: 6 },
        bind: { dblclick: () => () => { resetAll(); return null; } },
      },
      hooks: {
        drawClear: [gapPainter(() => this.drawn.gaps, () => spec.namesGap ?? false)],
        draw: [limitPainter(spec.limits ?? [])],
        setCursor: [(u) => this.moved(u)],
        setSelect: [(u) => this.selected(u)],
      },
    };
  }

  private moved(u: uPlot): void {
    const left = u.cursor.left ?? -1;
    if (u.root.matches(":hover")) setCursorTime(left >= 0 ? u.posToVal(left, "x") : null);
    this.writeValues();
  }

  private selected(u: uPlot): void {
    if (u.select.width < 6 || !u.root.matches(":hover")) return;
    const zoom: [number, number] = [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")];
    update({ pausedAtS: state.pausedAtS ?? ring.newestTimeS, zoom });
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }

  paint(nowMs: number): void {
    if (this.body.clientWidth === 0) return;
    const originS = state.pausedAtS ?? liveTimeS(nowMs);
    this.window = state.zoom ?? [-state.windowS, 0];
    const stamp = `${ring.version} ${originS.toFixed(2)} ${this.window} ${themeVersion()}`;
    if (stamp === this.seen || !Number.isFinite(originS)) return;
    this.seen = stamp;
    const pixels = Math.max(50, Math.round(this.plot.bbox.width / devicePixelRatio));
    const readers = this.spec.traces.map((trace) => trace.read());
    this.drawn = decimate(ring, readers, originS + this.window[0], originS + this.window[1], originS, pixels);
    this.range.fit(this.drawn.low, this.drawn.high);
    this.plot.setData([this.drawn.x, ...this.drawn.y] as uPlot.AlignedData);
    this.writeValues();
  }

  // The newest sample, or the one under the cursor.
  private writeValues(): void {
    const cursor = cursorTime();
    const cells = this.head.querySelectorAll<HTMLElement>("[data-trace]");
    const originS = state.pausedAtS ?? liveTimeS(performance.now());
    const i = cursor === null && state.pausedAtS === null ? ring.count - 1 : ring.before(originS + (cursor ?? 0));
    const stale = cursor === null && state.pausedAtS === null && isStale(performance.now());
    cells.forEach((cell) => {
      const trace = this.spec.traces[Number(cell.dataset.trace)];
      const text = trace ? fixed(trace.read()(i), this.spec.decimals) : "";
      if (cell.textContent !== text) cell.textContent = text;
      cell.classList.toggle("stale", stale);
    });
    const time = this.head.querySelector<HTMLElement>("[data-cursor]");
    if (time) {
      time.textContent = cursor === null ? (this.spec.sub ?? "") : `at ${fixed(cursor, 1)} s`;
      time.toggleAttribute("data-named", cursor !== null);
    }
  }
}

function bandColour(token: string): string {
  const alpha = Math.round(Number(colour("band-alpha")) * 255).toString(16).padStart(2, "0");
  return `${colour(token)}${alpha}`;
}

export function resetAll(): void {
  update({ zoom: null });
  window.dispatchEvent(new Event("reset-ranges"));
}

export function Chart({ spec }: { spec: ChartSpec }): JSX.Element {
  const head = useRef<HTMLElement>(null);
  const body = useRef<HTMLDivElement>(null);
  useEffect(() => {
    if (!head.current || !body.current) return undefined;
    const chart = new LiveChart(spec, body.current, head.current);
    const observer = new ResizeObserver(() => chart.resize());
    observer.observe(body.current);
    const stop = onFrame(DRAW_MS, (now) => chart.paint(now));
    const reset = (): void => chart.resetRange();
    const leave = (): void => setCursorTime(null);
    window.addEventListener("reset-ranges", reset);
    body.current.addEventListener("pointerleave", leave);
    return () => {
      stop();
      observer.disconnect();
      window.removeEventListener("reset-ranges", reset);
      chart.destroy();
    };
  }, [spec]);
  return (
    <section class="panel chart" data-testid={`chart-${spec.id}`} aria-label={`${spec.title}, ${spec.yLabel}`}>
      <header class="head" ref={head}>
        <h2>{spec.title}</h2>
        <span class="sub" data-cursor>{spec.sub}</span>
        <span class="legend">
          {spec.traces.map((trace, k) => !trace.silent && (
            <span class="entry" key={trace.label}>
              <i class={`swatch c-${trace.token}${trace.dash ? " dash" : ""}`} /><span class="name">{trace.label}</span>
              <b data-trace={k} data-testid={`chart-${spec.id}-${k}`} />
            </span>
          ))}
        </span>
      </header>
      <div class="plot" ref={body} />
    </section>
  );
}
