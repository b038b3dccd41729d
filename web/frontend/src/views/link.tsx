// Link: loss, latency and rate, what the flight process counts, and the log.

import type { JSX } from "preact";
import { Chart, type ChartSpec, signal } from "../charts/live_chart";
import { fixed } from "../format";
import { useClock } from "../frame_loop";
import { ring } from "../ring";
import { state } from "../store";
import { AlertsBody, SoundKey } from "./alerts_panel";
import { ToolRow } from "./tool_row";

const CHARTS: ChartSpec[] = [
  {
    id: "received", title: "Received", sub: "from sequence numbers", yLabel: "received, %", decimals: 1, range: { kind: "fixed", steps: [100], low: 0 },
    traces: [{ label: "share", token: "trace1", read: signal("link.received", 0, 100) }],
  },
  {
    id: "latency", title: "Round trip", sub: "by TIMESYNC", yLabel: "round trip, ms", decimals: 2, range: { kind: "span", steps: [4, 10, 20, 50, 100, 400, 1000] },
    traces: [{ label: "now", token: "trace1", read: signal("link.latency", 0, 1000) }],
  },
  {
    id: "message-rate", title: "Messages", yLabel: "rate, 1/s", decimals: 0, range: { kind: "span", steps: [200, 400, 800, 2000, 4000] },
    traces: [{ label: "all", token: "trace1", read: signal("link.rate") }],
  },
  {
    id: "tick", title: "Tick work", sub: "flight process", yLabel: "work, µs", decimals: 0, range: { kind: "span", steps: [400, 1000, 2000, 4000, 10000] },
    traces: [{ label: "tick", token: "trace1", read: signal("tick.duration", 0, 1e6) }], limits: [{ value: 1000, text: "limit 1000 µs" }],
  },
];

function Counts(): JSX.Element {
  useClock(500);
  const s = state.status;
  if (!s) return <p class="empty"><b>No vehicle yet.</b>The flight process has not reported. Start it with gcs up.</p>;
  const rows: [string, string, string][] = [
    ["Address", s.link_url, ""],
    ["State", s.link_state, ""],
    ["System", String(s.system_id), ""],
    ["Autopilot", s.autopilot, ""],
    ["Authority", s.authority, ""],
    ["Signing", s.signing || "unsigned", ""],
    ["Received", fixed(ring.value("link.received") * 100, 1), "%"],
    ["Round trip", fixed(ring.value("link.latency") * 1000, 2), "ms"],
    ["Messages", fixed(ring.value("link.rate"), 0), "1/s"],
    ["Ticks", String(s.ticks), ""],
    ["Tick work, 99 %", fixed(s.tick_p99_us, 0), "µs"],
    ["Frames dropped", String(s.dropped_frames), ""],
  ];
  return (
    <table class="grid-table"><tbody>{rows.map(([name, value, unit]) => (
      <tr key={name}><td>{name}</td><td class="strong">{value}</td><td class="unit-cell">{unit}</td></tr>))}</tbody></table>
  );
}

export function LinkView(): JSX.Element {
  return (
    <div class="link">
      <section class="panel"><header class="head"><h2>Link</h2></header><div class="scroll"><Counts /></div></section>
      <div class="middle"><ToolRow /><div class="charts">{CHARTS.map((spec) => <Chart key={spec.id} spec={spec} />)}</div></div>
      <section class="panel"><header class="head"><h2>Log</h2><span class="right">newest first <SoundKey /></span></header><AlertsBody /></section>
    </div>
  );
}
