// Closed-loop poles of the whole cascade, live to staged, with damping rays; poles beyond the axes are named.

import type { JSX } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import type { DesignReport, Pole } from "../design";
import { fixed } from "../format";
import { type Group, poleBelongs } from "../tune_groups";

interface Props {
  live: DesignReport | null;
  staged: DesignReport | null;
  group: Group;
}

interface Size {
  width: number;
  height: number;
}

const REAL: [number, number] = [-12, 2];
const IMAG_STEPS = [4, 10, 20, 40];
const DAMPINGS = [0.7, 0.5, 0.3];
// Where along its ray each damping is written, so that they never meet.
const LABEL_AT = [0.9, 0.86, 0.76] as const;
const MOVED = 0.02;
const MARGIN = { left: 34, right: 8, top: 6, bottom: 22 };

function visible(pole: Pole): boolean {
  return pole.real >= REAL[0] && pole.real <= REAL[1] && Math.abs(pole.imag) <= (IMAG_STEPS[IMAG_STEPS.length - 1] as number);
}

// Upper and lower of a pair: the report holds the upper one.
function both(pole: Pole): [number, number][] {
  return pole.imag === 0 ? [[pole.real, 0]] : [[pole.real, pole.imag], [pole.real, -pole.imag]];
}

// A staged pole that stays where a live one is needs no mark of its own.
function moved(pole: Pole, live: Pole[]): boolean {
  return !live.some((other) => Math.hypot(other.real - pole.real, other.imag - pole.imag) < MOVED);
}

function nearest(pole: Pole, among: Pole[]): Pole | null {
  const same = among.filter((other) => other.state === pole.state);
  const pool = same.length > 0 ? same : among;
  return pool.reduce<Pole | null>((best, other) => {
    const distance = Math.hypot(other.real - pole.real, other.imag - pole.imag);
    return !best || distance < Math.hypot(best.real - pole.real, best.imag - pole.imag) ? other : best;
  }, null);
}

class Plane {
  constructor(private readonly size: Size, readonly imag: number) {}

  get right(): number { return this.size.width - MARGIN.right; }
  get bottom(): number { return this.size.height - MARGIN.bottom; }

  x(real: number): number {
    return MARGIN.left + ((real - REAL[0]) / (REAL[1] - REAL[0])) * (this.right - MARGIN.left);
  }

  y(imag: number): number {
    return MARGIN.top + (1 - (imag + this.imag) / (2 * this.imag)) * (this.bottom - MARGIN.top);
  }
}

function Grid({ plane }: { plane: Plane }): JSX.Element {
  const reals = [-12, -10, -8, -6, -4, -2, 0, 2];
  const step = plane.imag / 2.5;
  const imags = [-2, -1, 0, 1, 2].map((k) => k * step);
  return (
    <g class="grid">
      <rect class="unstable" x={plane.x(0)} y={MARGIN.top} width={plane.right - plane.x(0)} height={plane.bottom - MARGIN.top} />
      {reals.map((v) => <g key={v}><line x1={plane.x(v)} x2={plane.x(v)} y1={MARGIN.top} y2={plane.bottom} /><text x={plane.x(v)} y={plane.bottom + 15} text-anchor="middle">{fixed(v, 0)}</text></g>)}
      {imags.map((v) => <g key={v}><line x1={MARGIN.left} x2={plane.right} y1={plane.y(v)} y2={plane.y(v)} class={v === 0 ? "axis" : ""} /><text x={MARGIN.left - 6} y={plane.y(v) + 4} text-anchor="end">{v === 0 ? "0" : `${fixed(v, Number.isInteger(step) ? 0 : 1)}j`}</text></g>)}
      <line class="axis" x1={plane.x(0)} x2={plane.x(0)} y1={MARGIN.top} y2={plane.bottom} />
      <text x={plane.x(0) + 5} y={MARGIN.top + 13}>unst.</text>
    </g>
  );
}

// Constant damping: real = -zeta wn, imag = wn sqrt(1 - zeta^2).
function Rays({ plane }: { plane: Plane }): JSX.Element {
  return (
    <g class="rays">
      {DAMPINGS.map((zeta, k) => {
        const slope = Math.sqrt(1 - zeta * zeta) / zeta;
        const reach = Math.min(-REAL[0], (plane.imag * 0.98) / slope);
        return (
          <g key={zeta}>
            {[1, -1].map((sign) => <line key={sign} x1={plane.x(0)} y1={plane.y(0)} x2={plane.x(-reach)} y2={plane.y(sign * reach * slope)} class={zeta === 0.3 ? "dashed" : ""} />)}
            <text x={plane.x(-reach * (LABEL_AT[k] ?? 1)) - 4} y={plane.y(reach * (LABEL_AT[k] ?? 1) * slope) + 4} text-anchor="end">ζ {zeta}</text>
          </g>
        );
      })}
    </g>
  );
}

function Cross({ x, y, kind }: { x: number; y: number; kind: string }): JSX.Element {
  return <path class={`pole ${kind}`} d={`M${x - 4} ${y - 4}l8 8m0 -8l-8 8`} />;
}

function offScale(poles: Pole[]): string {
  const out = poles.filter((pole) => !visible(pole));
  const fast = out.reduce<Pole | null>((best, pole) => (!best || pole.real > best.real ? pole : best), null);
  if (!fast) return "";
  const place = fast.imag === 0 ? fixed(fast.real, 0) : `${fixed(fast.real, 0)} ± ${fixed(fast.imag, 0)}j`;
  return `Off scale: ${fast.state} ${place}${out.length > 1 ? ` and ${out.length - 1} faster` : ""}`;
}

export function TunePoles({ live, staged, group }: Props): JSX.Element {
  const box = useRef<HTMLDivElement>(null);
  const [size, setSize] = useState<Size>({ width: 300, height: 300 });
  useEffect(() => {
    if (!box.current) return undefined;
    const observer = new ResizeObserver(([entry]) => entry && setSize({ width: entry.contentRect.width, height: entry.contentRect.height }));
    observer.observe(box.current);
    return () => observer.disconnect();
  }, []);
  const all = [...(live?.poles ?? []), ...(staged?.poles ?? [])].filter(visible);
  const tallest = Math.max(...all.map((pole) => pole.imag), 1);
  const plane = new Plane(size, IMAG_STEPS.find((step) => step >= tallest) ?? 40);
  const mark = (pole: Pole, kind: string): JSX.Element[] => both(pole).map(([re, im], k) => (
    <Cross key={`${kind}${pole.state}${pole.real}${pole.imag}${k}`} x={plane.x(re)} y={plane.y(im)} kind={poleBelongs(pole.state, group) ? kind : `${kind} other`} />));
  const shown = (live?.poles ?? []).filter(visible);
  return (
    <section class="panel poles" data-testid="tune-poles">
      <header class="head"><h2>Closed-loop poles</h2><span class="sub" title="Poles of the whole cascade, rotor lag and delay included">rad/s</span>
        <span class="right"><span class="c-text">× live</span>{staged && <span class="c-accent">× staged</span>}</span></header>
      <div class="plane" ref={box}>
        <svg width={size.width} height={size.height} role="img" aria-label={`${live?.poles.length ?? 0} poles, slowest ${fixed(live?.poles[0]?.real, 2)}`}>
          <Grid plane={plane} />
          <Rays plane={plane} />
          {staged && shown.map((pole) => {
            const to = nearest(pole, staged.poles.filter(visible));
            return to && both(pole).map(([re, im], k) => {
              const end = both(to)[k] ?? [to.real, 0];
              return <line key={`${pole.state}${pole.real}${k}`} class="path" x1={plane.x(re)} y1={plane.y(im)} x2={plane.x(end[0])} y2={plane.y(end[1])} />;
            });
          })}
          {shown.flatMap((pole) => mark(pole, "live"))}
          {staged && staged.poles.filter((pole) => visible(pole) && moved(pole, shown)).flatMap((pole) => mark(pole, "staged"))}
          <text class="note" x={MARGIN.left + 6} y={plane.bottom - 6}>{offScale((staged ?? live)?.poles ?? [])}</text>
        </svg>
      </div>
    </section>
  );
}
