// Below the scene: how old the picture is, window, pause.

import type { JSX } from "preact";
import { togglePause, WINDOWS } from "../actions";
import { Key, Segments } from "../controls";
import { fixed } from "../format";
import { useClock } from "../frame_loop";
import { resetZoom } from "../keys";
import { isStale, ring, sampleAgeS } from "../ring";
import { state, update, useStore } from "../store";

function Liveness(): JSX.Element {
  const now = useClock(250);
  if (ring.count === 0) return <span class="live" data-testid="liveness"><b>Waiting</b> for the first sample</span>;
  if (state.pausedAtS !== null) {
    return <span class="live paused" data-testid="liveness"><b>Paused</b> {fixed(ring.newestTimeS - state.pausedAtS, 0)} s behind</span>;
  }
  const ageS = sampleAgeS(now);
  const age = ageS < 1 ? `${(ageS * 1000).toFixed(0)} ms` : `${ageS.toFixed(1)} s`;
  if (isStale(now)) return <span class="live" data-testid="liveness"><b>Stale</b>, last sample {age} old</span>;
  return <span class="live" data-testid="liveness"><b>Live</b>, {fixed(1 / ring.periodS, 0)} Hz, last sample {age} old</span>;
}

const OPTIONS = WINDOWS.map((seconds) => ({ value: String(seconds), text: seconds === 120 ? "120 s" : String(seconds) }));

export function ToolRow(): JSX.Element {
  const windowS = useStore((s) => s.windowS);
  const paused = useStore((s) => s.pausedAtS !== null);
  const zoomed = useStore((s) => s.zoom !== null);
  return (
    <div class="panel tool-row">
      <Liveness />
      <span class="right">
        {zoomed && <Key testid="reset-zoom" onAct={resetZoom}>Reset zoom</Key>}
        <span class="caption">Window</span>
        <Segments testid="window" label="Window" options={OPTIONS} value={String(windowS)} onPick={(value) => update({ windowS: Number(value), zoom: null })} />
        <Key testid="pause" onAct={() => togglePause(ring.newestTimeS)}>{paused ? "Resume" : "Pause"}</Key>
      </span>
    </div>
  );
}
