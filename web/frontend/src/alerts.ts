// Alerts: events of the station plus conditions this page can see for itself. Order: level, then newest.

import type { Level, StationEvent, Status } from "./protocol";
import { type LoggedEvent, type State, state, update } from "./store";

const KEEP = 400;
const ADVISORY_S = 60;
const REPEAT_S = 30;
const STATUS_S = 3;
export const LEVEL_ORDER: Record<Level, number> = { warning: 0, caution: 1, advisory: 2 };

let nextId = 1;

function utcOf(event: StationEvent): number {
  const status = state.status;
  return status && event.t_s !== null ? status.utc_s + (event.t_s - status.t_s) : Date.now() / 1000;
}

function logged(event: StationEvent, acknowledged: boolean): LoggedEvent {
  return { ...event, id: nextId++, utc_s: utcOf(event), count: 1, acknowledged, receivedMs: performance.now() };
}

// Repeats of one sentence collapse into one row with a count.
export function log(event: StationEvent): void {
  const newest = state.events[0];
  if (newest && newest.text === event.text && newest.level === event.level && utcOf(event) - newest.utc_s < REPEAT_S) {
    const merged = { ...newest, ...event, utc_s: utcOf(event), count: newest.count + 1, receivedMs: performance.now() };
    update({ events: [merged, ...state.events.slice(1)] });
    return;
  }
  update({ events: [logged(event, false), ...state.events].slice(0, KEEP) });
}

// Old events are history, not alerts: they come in acknowledged.
export function seedEvents(events: StationEvent[]): void {
  update({ events: [...events].reverse().map((event) => logged(event, true)) });
}

// A warning stays until acknowledged; a caution and an advisory leave the bar after a minute, a caution keeps its shape in the log.
export function isOpen(event: LoggedEvent, nowMs: number): boolean {
  if (event.acknowledged) return false;
  return event.level === "warning" || nowMs - event.receivedMs < ADVISORY_S * 1000;
}

export interface Alert {
  level: Level;
  text: string;
  utc_s: number;
  id: number | null;
}

// Empty while there is none.
export function failsafeOf(status: Status): string {
  return status.failsafe === "none" ? "" : status.failsafe;
}

// Conditions that open and clear by themselves.
export function conditions(s: State, nowMs: number): Alert[] {
  const alerts: Alert[] = [];
  const status = s.status;
  const utc_s = Date.now() / 1000;
  const add = (level: Level, text: string): void => void alerts.push({ level, text, utc_s, id: null });
  if (s.station === "lost") add("warning", "No connection to the station. Nothing you press is sent.");
  if (s.station === "lost") return alerts;
  if (!status) {
    if (s.station === "live" && nowMs - s.stationLiveMs > STATUS_S * 1000) add("warning", "No word from the flight process. Look at the output of gcs up.");
    return alerts;
  }
  if (status.recording_state === "stopped") add("caution", `Recording stopped: ${status.recording_reason ?? ""}`);
  const silence = linkSilenceS(s, nowMs);
  if (status.link_state === "lost") add("warning", `Link lost ${silence.toFixed(1)} s. Vehicle holds by failsafe.`);
  else if (status.link_state === "silent") add("caution", `No messages for ${silence.toFixed(1)} s.`);
  if (failsafeOf(status)) add("warning", `Failsafe: ${failsafeOf(status)}`);
  const quietS = (nowMs - s.statusMs) / 1000;
  if (quietS > STATUS_S) add("warning", `Flight process silent ${quietS.toFixed(0)} s. The vehicle acts by its own failsafe.`);
  const charge = status.battery_remaining;
  if (charge !== null && charge >= 0 && charge < 0.1) add("warning", `Battery ${(charge * 100).toFixed(0)} %, limit 10 %. Land.`);
  else if (charge !== null && charge >= 0 && charge < 0.2) add("caution", `Battery ${(charge * 100).toFixed(0)} %, limit 20 %.`);
  return alerts;
}

export function linkSilenceS(s: State, nowMs: number): number {
  return s.status ? s.status.link_silence_s + (nowMs - s.statusMs) / 1000 : 0;
}

export function openAlerts(s: State, nowMs: number): Alert[] {
  const events = s.events.filter((event) => isOpen(event, nowMs));
  const all: Alert[] = [...conditions(s, nowMs), ...events];
  return all.sort((a, b) => LEVEL_ORDER[a.level] - LEVEL_ORDER[b.level] || b.utc_s - a.utc_s);
}

// Advisories are told, not open: they need nothing of anybody.
export function openCount(s: State, nowMs: number): number {
  return openAlerts(s, nowMs).filter((alert) => alert.level !== "advisory").length;
}

export function acknowledge(id?: number): void {
  const top = id ?? openAlerts(state, performance.now()).find((alert) => alert.id !== null)?.id;
  if (top === undefined || top === null) return;
  update({ events: state.events.map((event) => (event.id === top ? { ...event, acknowledged: true } : event)) });
}
