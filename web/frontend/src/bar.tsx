// Safety bar: the highest open alert at left, the four keys at right, the same in every view and state.

import type { JSX } from "preact";
import { hold, land, lastGoodGains, toggleControls } from "./actions";
import { acknowledge, openAlerts, openCount } from "./alerts";
import { Key, Mark } from "./controls";
import { clock } from "./format";
import { useClock } from "./frame_loop";
import { airborne, holdsControls, state, useStore } from "./store";

function Notice(): JSX.Element {
  const now = useClock(200);
  const s = state;
  const open = openAlerts(s, now);
  const today = s.events.length;
  const count = <span class="count">{openCount(s, now)} open, {today} logged</span>;
  if (s.notice && s.notice.untilMs > now && s.station !== "lost") {
    return (
      <div class={`notice ${s.notice.level}`} data-testid="bar-notice" role="status">
        <Mark level={s.notice.level} /><span class="text">{s.notice.text}</span>
      </div>
    );
  }
  const top = open[0];
  if (!top) return <div class="notice" data-testid="bar-notice" role="status"><span class="count">0 open, {today} logged</span></div>;
  return (
    <div class={`notice ${top.level}`} data-testid="bar-notice" role={top.level === "warning" ? "alert" : "status"}>
      <Mark level={top.level} />
      <span class="when">{clock(top.utc_s)}</span>
      <span class="text">{top.text}</span>
      {top.id !== null && top.level !== "advisory" && <Key testid="bar-acknowledge" onAct={() => acknowledge()}><span>Acknowledge</span><kbd>A</kbd></Key>}
      {count}
    </div>
  );
}

export function Bar(): JSX.Element {
  const lost = useStore((s) => s.station === "lost");
  const mine = useStore(holdsControls);
  const observer = useStore((s) => s.session?.role === "observer");
  const inAir = useStore(airborne);
  const holder = useStore((s) => s.status?.controls_holder ?? "");
  const off = lost || observer;
  return (
    <footer class="bar" data-testid="bar">
      <Notice />
      <div class="safety">
        <Key testid="key-controls" disabled={off} title={holder && !mine ? `Held by ${holder}` : undefined} onAct={toggleControls}>
          <span>{mine ? "Release controls" : "Take controls"}</span><kbd>C</kbd>
        </Key>
        <Key testid="key-hold" disabled={off} onAct={hold}><span>Hold</span><kbd>H</kbd></Key>
        <Key testid="key-land" disabled={off} hold={inAir} onAct={land}><span>Land</span><kbd>L{inAir && " hold"}</kbd></Key>
        <Key testid="key-last-good" disabled={off} hold={inAir} onAct={lastGoodGains}><span>Last good gains</span><kbd>G{inAir && " hold"}</kbd></Key>
      </div>
    </footer>
  );
}
