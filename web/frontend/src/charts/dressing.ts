// What all charts share: axes, grid, shaded gaps, limit lines.

import type uPlot from "uplot";
import { fixed } from "../format";
import { colour } from "../theme";
import type { Gap } from "./decimate";

function labelFont(): string {
  const root = getComputedStyle(document.documentElement);
  return `${root.getPropertyValue("--fs-label").trim()} ${root.getPropertyValue("--condensed").trim()}`;
}

// As many decimals as the ticks need to be told exactly, at most four.
function decimalsOf(splits: number[]): number {
  const span = Math.max(...splits) - Math.min(...splits) || 1;
  for (let decimals = 0; decimals < 4; decimals++) {
    if (splits.every((split) => Math.abs(split - Number(split.toFixed(decimals))) < 1e-6 * span)) return decimals;
  }
  return 4;
}

function numbers(splits: number[]): string[] {
  const decimals = decimalsOf(splits);
  const texts = splits.map((split) => fixed(split, decimals));
  return texts.map((text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text));
}

// The unit stands on the last tick.
function times(unit: string): (u: uPlot, splits: number[]) => string[] {
  return (u, splits) => {
    const texts = numbers(splits);
    const last = splits.length - 1;
    if (last >= 0 && (splits[last] as number) <= (u.scales.x?.max ?? Infinity)) texts[last] += ` ${unit}`;
    return texts;
  };
}

const QUARTERS_FIT_PX = 64;

// Four equal parts of the range, two where there is no room.
function quarters(range: { low: number; high: number }, heightPx: number): number[] {
  const parts = heightPx >= QUARTERS_FIT_PX ? 4 : 2;
  return Array.from({ length: parts + 1 }, (_, k) => Number((range.low + ((range.high - range.low) * k) / parts).toPrecision(6)));
}

export function axes(yLabel: string, xUnit = "s", range?: () => { low: number; high: number }): uPlot.Axis[] {
  const shared = {
    stroke: () => colour("text3"),
    grid: { stroke: () => colour("grid"), width: 1 },
    ticks: { show: false },
    font: labelFont(),
  };
  return [
    { ...shared, size: 20, gap: 3, space: 44, values: times(xUnit) },
    { ...shared, ...(range ? { splits: (u: uPlot) => quarters(range(), u.bbox.height / devicePixelRatio) } : {}), size: 38, gap: 4, space: 24, values: (_u, splits) => numbers(splits), label: yLabel, labelSize: 16, labelGap: 0, labelFont: labelFont() },
  ];
}

export function gapPainter(gaps: () => Gap[], named: () => boolean): (u: uPlot) => void {
  return (u) => {
    const { ctx, bbox } = u;
    ctx.save();
    const longest = Math.max(...gaps().map((gap) => gap.toS - gap.fromS));
    for (const gap of gaps()) {
      const left = Math.max(bbox.left, u.valToPos(gap.fromS, "x", true));
      const right = Math.min(bbox.left + bbox.width, u.valToPos(gap.toS, "x", true));
      if (right <= left) continue;
      ctx.fillStyle = colour("raise");
      ctx.fillRect(left, bbox.top, Math.max(1, right - left), bbox.height);
      if (!named() || gap.toS - gap.fromS < longest) continue;
      ctx.fillStyle = colour("text3");
      ctx.font = `${11 * devicePixelRatio}px ${getComputedStyle(document.documentElement).getPropertyValue("--condensed")}`;
      ctx.textBaseline = "bottom";
      ctx.textAlign = left > bbox.left + bbox.width * 0.7 ? "right" : "left";
      ctx.fillText(`gap ${(gap.toS - gap.fromS).toFixed(2)} s`, left + (ctx.textAlign === "right" ? -4 : 4), bbox.top + bbox.height - 2);
    }
    ctx.restore();
  };
}

export interface Limit {
  value: number;
  text: string;
  // A value that is expected rather than a limit is drawn as a reference.
  expected?: boolean;
}

export function limitPainter(limits: Limit[]): (u: uPlot) => void {
  return (u) => {
    const { ctx, bbox } = u;
    ctx.save();
    for (const limit of limits) {
      const y = u.valToPos(limit.value, "y", true);
      if (y < bbox.top || y > bbox.top + bbox.height) continue;
      const ink = colour(limit.expected ? "reference" : "caution");
      ctx.strokeStyle = ink;
      ctx.setLineDash([5 * devicePixelRatio, 4 * devicePixelRatio]);
      ctx.lineWidth = devicePixelRatio;
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      ctx.fillStyle = ink;
      ctx.font = `${11 * devicePixelRatio}px ${getComputedStyle(document.documentElement).getPropertyValue("--condensed")}`;
      ctx.textAlign = "left";
      ctx.textBaseline = "bottom";
      ctx.fillText(limit.text, bbox.left + 4, y - 2);
    }
    ctx.restore();
  };
}
