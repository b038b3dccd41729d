// What the keys of the bar and the keyboard do. Words here are the words of the buttons.

import { send } from "./api";
import type { KeeperOrder } from "./keeper";
import type { Answer } from "./protocol";
import { holdsControls, say, state, subscribe, update } from "./store";

const PULSE_MS = 1000;

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

// Five silent seconds lose the controls: a worker says that the holder is there, as long as this page is alive.
export function startKeepingControls(): void {
  const keeper = new Worker(document.documentElement.dataset.keeper ?? "");
  const tell = (): void => keeper.postMessage({ csrf: state.session?.csrf ?? "", holding: state.station === "live" && holdsControls(state) } satisfies KeeperOrder);
  let told = false;
  setInterval(tell, PULSE_MS);
  subscribe(() => {
    if (holdsControls(state) === told) return;
    told = holdsControls(state);
    tell();
  });
}
