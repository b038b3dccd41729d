// What the keys of the bar and the keyboard do. Words here are the words of the buttons.

import { send } from "./api";
import type { Answer } from "./protocol";
import { holdsControls, say, state, update } from "./store";

const KEEP_MS = 1500;

export function toggleControls(): void {
  void send({ type: holdsControls(state) ? "release_controls" : "take_controls" });
}

export function hold(): void {
  void send({ type: "hold" }).then((answer) => answer.accepted && say("advisory", "Hold sent.", 4));
}

export function land(): void {
  void send({ type: "land" }).then((answer) => answer.accepted && say("advisory", "Land sent.", 4));
}

export function lastGoodGains(): void {
  void send({ type: "last_good_gains" }).then((answer) => answer.accepted && say("advisory", "Last good gains sent.", 4));
}

export function undoGains(): Promise<Answer> {
  return send({ type: "undo_gains", why: "Undo from the dashboard" });
}

export function togglePause(newestS: number): void {
  if (state.pausedAtS === null) update({ pausedAtS: newestS });
  else update({ pausedAtS: null, zoom: null });
}

export const WINDOWS = [10, 30, 120] as const;

export function stepWindow(step: 1 | -1): void {
  const at = WINDOWS.findIndex((seconds) => seconds === state.windowS);
  const next = WINDOWS[Math.min(WINDOWS.length - 1, Math.max(0, at + step))];
  if (next !== undefined) update({ windowS: next, zoom: null });
}

// Five silent seconds lose the controls: the holder says that it is there.
export function startKeepingControls(): void {
  setInterval(() => {
    if (state.station === "live" && holdsControls(state)) void send({ type: "keep_controls" });
  }, KEEP_MS);
}
