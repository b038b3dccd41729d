// Tones: three each two seconds for an open warning, one for a new caution. Off until the browser allows it, and then said so.

import { openAlerts } from "./alerts";
import { state, update } from "./store";

const WARNING_REPEAT_MS = 2000;
let context: AudioContext | null = null;
let cautionsHeard = new Set<string>();

function tone(frequencyHz: number, startS: number, lengthS: number): void {
  if (!context) return;
  const oscillator = context.createOscillator();
  const gain = context.createGain();
  oscillator.frequency.value = frequencyHz;
  gain.gain.value = 0.15;
  oscillator.connect(gain).connect(context.destination);
  oscillator.start(context.currentTime + startS);
  oscillator.stop(context.currentTime + startS + lengthS);
}

function check(): void {
  if (state.sound !== "on") return;
  const open = openAlerts(state, performance.now());
  if (open.some((alert) => alert.level === "warning")) [0, 0.18, 0.36].forEach((at) => tone(880, at, 0.12));
  const cautions = new Set(open.filter((alert) => alert.level === "caution").map((alert) => String(alert.id ?? alert.text.replace(/[\d.]+/g, ""))));
  if ([...cautions].some((key) => !cautionsHeard.has(key))) tone(587, 0, 0.25);
  cautionsHeard = cautions;
}

export function toggleSound(): void {
  if (state.sound === "on") return update({ sound: "off" });
  context ??= new AudioContext();
  void context.resume().then(() => {
    update({ sound: context?.state === "running" ? "on" : "blocked" });
    tone(587, 0, 0.15);
  });
}

export function startSound(): void {
  setInterval(check, WARNING_REPEAT_MS);
}
