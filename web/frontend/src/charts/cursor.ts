// One cursor time for all live charts, seconds relative to now (negative), null when no pointer is over a chart.

let cursorS: number | null = null;

export function cursorTime(): number | null {
  return cursorS;
}

export function setCursorTime(relativeS: number | null): void {
  cursorS = relativeS;
}
