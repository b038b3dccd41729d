// Keyboard: one map for the page and for the scene frame. Letters are ignored while typing.

import { hold, land, lastGoodGains, stepWindow, toggleControls, togglePause } from "./actions";
import { acknowledge } from "./alerts";
import { HOLD_MS } from "./controls";
import { ring } from "./ring";
import { airborne, state, update, VIEWS } from "./store";

// The part of a key press that matters, so that the scene can hand presses over as messages.
export interface Press {
  key: string;
  ctrlKey: boolean;
  shiftKey: boolean;
  repeat: boolean;
}

let heldKey = "";
let heldTimer = 0;

function holdKey(key: string, testid: string, act: () => void): void {
  if (!airborne(state)) return act();
  if (heldKey) return;
  heldKey = key;
  const button = document.querySelector(`[data-testid="${testid}"]`);
  button?.classList.add("pressing");
  heldTimer = window.setTimeout(() => {
    releaseKey(key);
    act();
  }, HOLD_MS);
}

export function releaseKey(key: string): void {
  if (heldKey !== key.toLowerCase()) return;
  clearTimeout(heldTimer);
  heldKey = "";
  for (const button of document.querySelectorAll(".key.pressing")) button.classList.remove("pressing");
}

export function resetZoom(): void {
  update({ zoom: null });
  window.dispatchEvent(new Event("reset-ranges"));
}

function shortcut(press: Press): (() => void) | null {
  const key = press.key.toLowerCase();
  if (press.ctrlKey) {
    if (key === "enter") return () => holdKey("enter", "tune-apply", () => window.dispatchEvent(new Event("apply-staged")));
    if (key === "z") return () => window.dispatchEvent(new Event("undo-gains"));
    return null;
  }
  if (/^[1-7]$/.test(key)) return () => update({ view: VIEWS[Number(key) - 1] ?? "fly" });
  switch (key) {
    case " ": return () => togglePause(ring.newestTimeS);
    case "[": return () => stepWindow(-1);
    case "]": return () => stepWindow(1);
    case "/": return () => window.dispatchEvent(new Event("find-field"));
    case "?": return () => update({ keySheet: !state.keySheet });
    case "escape": return () => update({ keySheet: false });
  }
  if (!state.letterKeys) return null;
  switch (key) {
    case "c": return toggleControls;
    case "h": return hold;
    case "l": return () => holdKey("l", "key-land", land);
    case "g": return () => holdKey("g", "key-last-good", lastGoodGains);
    case "a": return () => acknowledge();
    case "m": return () => window.dispatchEvent(new Event("mark-event"));
    case "z": return resetZoom;
  }
  return null;
}

// True when the press was one of ours.
export function press(event: Press): boolean {
  const act = shortcut(event);
  if (!act) return false;
  if (state.station === "lost" && /^[chlg]$/i.test(event.key)) return true;
  if (!event.repeat) act();
  return true;
}

function typing(target: EventTarget | null): boolean {
  return target instanceof HTMLElement && (target.matches("input, select, textarea") || target.isContentEditable);
}

export function listenForKeys(target: Window): void {
  target.addEventListener("keydown", (event) => {
    if (event.altKey || event.metaKey || (typing(event.target) && !event.ctrlKey)) return;
    const onButton = event.target instanceof HTMLElement && event.target.matches("button");
    if (onButton && (event.key === " " || event.key === "Enter") && !event.ctrlKey) return;
    if (typing(event.target) && event.key.toLowerCase() === "z") return;
    if (press(event)) event.preventDefault();
  });
  target.addEventListener("keyup", (event) => releaseKey(event.key));
  // A button pressed with the pointer gives the keyboard back, so that Space pauses instead of pressing it again.
  target.addEventListener("click", (event) => {
    if (event.detail > 0 && event.target instanceof Element) event.target.closest("button")?.blur();
  });
}
