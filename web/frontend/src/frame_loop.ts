// One requestAnimationFrame for the whole page. Painters say how often they want to draw; a slow machine gets fewer draws.

import { useEffect, useState } from "preact/hooks";

type Paint = (nowMs: number) => void;

interface Painter {
  paint: Paint;
  intervalMs: number;
  dueMs: number;
}

const painters = new Set<Painter>();
const SHARE = 4;
let scheduled = false;

function run(nowMs: number): void {
  scheduled = false;
  for (const painter of [...painters]) {
    if (nowMs < painter.dueMs) continue;
    const began = performance.now();
    painter.paint(began);
    const cost = performance.now() - began;
    painter.dueMs = nowMs + Math.max(painter.intervalMs - 4, cost * SHARE);
  }
  schedule();
}

function schedule(): void {
  if (scheduled || painters.size === 0) return;
  scheduled = true;
  requestAnimationFrame(run);
}

export function onFrame(intervalMs: number, paint: Paint): () => void {
  const painter: Painter = { paint, intervalMs, dueMs: 0 };
  painters.add(painter);
  schedule();
  return () => {
    painters.delete(painter);
  };
}

// Renders the component again every so often, in step with the page's one frame.
export function useClock(intervalMs: number): number {
  const [now, setNow] = useState(() => performance.now());
  useEffect(() => onFrame(intervalMs, setNow), [intervalMs]);
  return now;
}
