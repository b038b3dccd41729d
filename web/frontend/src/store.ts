// One store for what people see at human speed. Signal samples never pass through it: they live in rings.

import { useEffect, useState } from "preact/hooks";
import type { Level, Session, StationEvent, Status } from "./protocol";

export type ViewName = "fly" | "tune" | "model" | "identify" | "estimate" | "link" | "runs";
export const VIEWS: ViewName[] = ["fly", "tune", "model", "identify", "estimate", "link", "runs"];

export interface LoggedEvent extends StationEvent {
  id: number;
  utc_s: number;
  count: number;
  acknowledged: boolean;
  receivedMs: number;
}

export interface Notice {
  level: Level;
  text: string;
  untilMs: number;
}

export interface State {
  session: Session | null;
  station: "connecting" | "live" | "lost";
  stationLostMs: number;
  stationLiveMs: number;
  status: Status | null;
  statusMs: number;
  events: LoggedEvent[];
  watchers: string[];
  view: ViewName;
  windowS: number;
  pausedAtS: number | null;
  zoom: [number, number] | null;
  notice: Notice | null;
  keySheet: boolean;
  sound: "off" | "on" | "blocked";
  letterKeys: boolean;
}

type Listener = () => void;

const listeners = new Set<Listener>();

export let state: State = {
  session: null,
  station: "connecting",
  stationLostMs: 0,
  stationLiveMs: 0,
  status: null,
  statusMs: 0,
  events: [],
  watchers: [],
  view: "fly",
  windowS: 30,
  pausedAtS: null,
  zoom: null,
  notice: null,
  keySheet: false,
  sound: "off",
  letterKeys: true,
};

export function update(part: Partial<State>): void {
  state = { ...state, ...part };
  for (const listener of [...listeners]) listener();
}

export function subscribe(listener: Listener): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

// Renders again only when the selected value changes.
export function useStore<T>(select: (state: State) => T): T {
  const [value, setValue] = useState(() => select(state));
  useEffect(() => {
    const refresh = (): void => setValue(() => select(state));
    refresh();
    return subscribe(refresh);
    // The selector is the same expression at every render of a component.
  }, []);
  return value;
}

export function say(level: Level, text: string, seconds = 8): void {
  update({ notice: { level, text, untilMs: performance.now() + seconds * 1000 } });
}

export function holdsControls(s: State): boolean {
  if (!s.session || !s.status || !s.status.controls_holder) return false;
  if (s.session.client) return s.status.controls_client === s.session.client;
  return s.status.controls_holder === s.session.name;
}

export function airborne(s: State): boolean {
  return s.status !== null && s.status.armed && s.status.landed !== "on ground";
}

export function flying(s: State): boolean {
  return s.status !== null && (s.status.state === "Offboard" || s.status.state === "Streaming");
}
