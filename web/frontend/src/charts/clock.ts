// The right edge of live charts in vehicle time: it keeps running when samples stop, so that charts run on empty.

import { isStale, ring, sampleAgeS } from "../ring";

export function liveTimeS(nowMs: number): number {
  return ring.newestTimeS + (isStale(nowMs) ? sampleAgeS(nowMs) : 0);
}
