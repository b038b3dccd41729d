// Status strip: eleven cells, always in this order. Only an abnormal cell takes colour.

import type { ComponentChildren, JSX } from "preact";
import { failsafeOf, linkSilenceS } from "./alerts";
import { clock, fixed, megabytes, minutes } from "./format";
import { useClock } from "./frame_loop";
import { isStale, ring } from "./ring";
import { holdsControls, state, type State, update, useStore, type ViewName } from "./store";

type Tone = "" | "accent" | "caution" | "warning" | "stale";

interface CellProps {
  name: string;
  label: string;
  tone?: Tone;
  view: ViewName;
  children: ComponentChildren;
}

function Cell({ name, label, tone = "", view, children }: CellProps): JSX.Element {
  return (
    <button type="button" class={`cell ${tone}`} data-testid={`strip-${name}`} onClick={() => update({ view })}>
      <span class="label">{label}</span>
      <span class="value">{children}</span>
    </button>
  );
}

const OURS = ["Streaming", "Offboard", "Degraded"];
const CONTROLLER_NAMES = { lqr: "LQR+I", pid: "PI" } as const;
export function controllerName(kind: "lqr" | "pid"): string {
  return CONTROLLER_NAMES[kind];
}

function LinkCell({ s, now }: { s: State; now: number }): JSX.Element {
  const status = s.status;
  if (!status || status.link_state === "none") return <Cell name="link" label="Link" view="link">No vehicle</Cell>;
  if (status.link_state === "lost") {
    return <Cell name="link" label="Link" tone="warning" view="link">Lost {linkSilenceS(s, now).toFixed(1)} s</Cell>;
  }
  const received = ring.value("link.received") * 100;
  const latency = ring.value("link.latency") * 1000;
  const tone: Tone = status.link_state === "silent" ? "caution" : isStale(now) ? "stale" : "";
  return (
    <Cell name="link" label="Link" tone={tone} view="link">
      {fixed(received, 1)} % <i>{fixed(latency, latency < 10 ? 1 : 0)} ms<span class="wide">, {fixed(ring.value("link.rate"), 0)} msg/s</span></i>
    </Cell>
  );
}

function ModeCell({ s }: { s: State }): JSX.Element {
  const status = s.status;
  if (!status) return <Cell name="mode" label="Mode" view="fly">–</Cell>;
  const lost = status.link_state === "lost";
  const failsafe = lost ? "Failsafe expected: hold" : failsafeOf(status);
  // While we do not steer, the vehicle's own mode says more than our state.
  const mode = OURS.includes(status.state) || !status.vehicle_mode ? status.state : status.vehicle_mode;
  const tone: Tone = failsafe ? "warning" : status.state === "Degraded" ? "caution" : "";
  return (
    <Cell name="mode" label="Mode" tone={tone} view="fly">
      {failsafe || <>{mode}, {status.armed ? "armed" : "disarmed"} <i class="wide">no failsafe</i></>}
    </Cell>
  );
}

function EstimatorCell({ s, now }: { s: State; now: number }): JSX.Element {
  const name = s.status?.estimator || "–";
  return (
    <Cell name="estimator" label="Estimator" tone={isStale(now) ? "stale" : ""} view="estimate">
      {name} {s.status && <i class="wide">NIS {fixed(ring.value("estimate.nis"), 2)}</i>}
    </Cell>
  );
}

function ControlsCell({ s }: { s: State }): JSX.Element {
  const holder = s.status?.controls_holder ?? "";
  const mine = holdsControls(s);
  return (
    <Cell name="controls" label="Controls" tone={mine ? "accent" : ""} view="fly">
      {mine ? "You" : holder || "Free"} <i class="wide">{s.watchers.length} watching</i>
    </Cell>
  );
}

function BatteryCell({ s, now }: { s: State; now: number }): JSX.Element {
  const charge = s.status?.battery_remaining ?? null;
  const tone: Tone = charge !== null && charge >= 0 && charge < 0.1 ? "warning" : charge !== null && charge >= 0 && charge < 0.2 ? "caution" : "";
  return (
    <Cell name="battery" label="Battery" tone={tone || (isStale(now) ? "stale" : "")} view="fly">
      {s.status && s.status.battery_v !== null ? <>{fixed(s.status.battery_v, 2)} V <i>{charge === null || charge < 0 ? "" : `${fixed(charge * 100, 0)} %`}</i></> : "–"}
    </Cell>
  );
}

// A run is named after its start: 20260102T030405Z-name.
function startedUtcS(run: string): number {
  const parts = /^(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)Z/.exec(run)?.slice(1).map(Number);
  if (!parts) return NaN;
  const [year = 0, month = 1, day = 1, hour = 0, minute = 0, second = 0] = parts;
  return Date.UTC(year, month - 1, day, hour, minute, second) / 1000;
}

function RecordingCell({ s, now }: { s: State; now: number }): JSX.Element {
  const status = s.status;
  const word = status?.recording_state ?? "off";
  if (!status || word !== "recording") {
    const text = { off: "Off", waiting: "Waiting", stopped: "Stopped", recording: "" }[word];
    return <Cell name="recording" label="Recording" tone={word === "stopped" ? "caution" : ""} view="runs">{text}</Cell>;
  }
  return (
    <Cell name="recording" label="Recording" view="runs">
      <svg class="dot" viewBox="0 0 10 10" width="9" height="9" aria-hidden="true"><circle cx="5" cy="5" r="4.5" fill="currentColor" /></svg>{" "}
      {minutes(utcNow(s, now) - startedUtcS(status.recording ?? ""))} <i class="wide">{megabytes(status.recording_bytes ?? 0)}</i>
    </Cell>
  );
}

// The polite live region says changes of state only, never numbers that run.
function announcement(s: State): string {
  const status = s.status;
  if (!status) return "No vehicle";
  return `${status.state}, ${status.armed ? "armed" : "disarmed"}, link ${status.link_state}, ${controllerName(status.controller)} set ${status.gain_set}`;
}

function utcNow(s: State, now: number): number {
  return s.status && s.station === "live" ? s.status.utc_s + (now - s.statusMs) / 1000 : Date.now() / 1000;
}

export function Strip(): JSX.Element {
  const now = useClock(200);
  useStore((s) => s.status);
  const s = state;
  const status = s.status;
  const signed = status !== null && !["", "off", "none", "unsigned"].includes(status.signing.toLowerCase());
  return (
    <header class="strip" data-testid="strip" aria-label="Vehicle status">
      <Cell name="vehicle" label="Vehicle" view="fly">
        {status?.vehicle_name || "None"} <i>{status && `sysid ${status.system_id}`}<span class="wide">{status && `, ${status.autopilot}`}</span></i>
      </Cell>
      <LinkCell s={s} now={now} />
      <Cell name="signing" label="Signing" view="link">{signed ? status.signing : "Unsigned"}</Cell>
      <ModeCell s={s} />
      <EstimatorCell s={s} now={now} />
      <Cell name="controller" label="Controller" view="tune">
        {status ? controllerName(status.controller) : "–"} <i>{status && `set ${status.gain_set}`}</i>
      </Cell>
      <Cell name="compensator" label="Compensator" view="model">Off</Cell>
      <ControlsCell s={s} />
      <BatteryCell s={s} now={now} />
      <Cell name="time" label="UTC, flight" view="runs">{clock(utcNow(s, now))} <i>{status ? minutes(status.flight_time_s) : "–"}</i></Cell>
      <RecordingCell s={s} now={now} />
      <p class="unseen" aria-live="polite">{announcement(s)}</p>
    </header>
  );
}
