// Key sheet: a side panel, with the choices that belong to the person at the desk.

import type { JSX } from "preact";
import { useState } from "preact/hooks";
import { Key, Segments } from "./controls";
import { update, useStore } from "./store";
import { chooseTheme, type ThemeChoice, themeChoice } from "./theme";

const KEYS: [string, string][] = [
  ["1 – 7", "Views"], ["C", "Take / release controls"], ["H", "Hold"], ["L, hold 0.8 s", "Land"], ["G, hold 0.8 s", "Last good gains"],
  ["A", "Acknowledge top alert"], ["M", "Mark event with a note"], ["Space", "Pause drawing"], ["Z", "Reset zoom and ranges"],
  ["[ ]", "Shorter / longer window"], ["/", "Find field"], ["Ctrl+Enter", "Apply"], ["Ctrl+Z", "Undo gains"], ["?", "This sheet"],
];
const THEMES = [{ value: "system", text: "System" }, { value: "dark", text: "Dark" }, { value: "light", text: "Light" }] as const;
const LETTERS = [{ value: "on", text: "On" }, { value: "off", text: "Off" }] as const;

export function KeySheet(): JSX.Element | null {
  const open = useStore((s) => s.keySheet);
  const letters = useStore((s) => s.letterKeys);
  const [theme, setTheme] = useState<ThemeChoice>(themeChoice);
  if (!open) return null;
  const pick = (choice: ThemeChoice): void => {
    chooseTheme(choice);
    setTheme(choice);
  };
  return (
    <aside class="panel key-sheet" data-testid="key-sheet" aria-label="Keys">
      <header class="head"><h2>Keys</h2><span class="right"><Key testid="key-sheet-close" onAct={() => update({ keySheet: false })}>Close</Key></span></header>
      <table class="grid-table"><tbody>{KEYS.map(([key, text]) => <tr key={key}><td>{text}</td><td><kbd>{key}</kbd></td></tr>)}</tbody></table>
      <div class="choice"><span>Letter keys</span><Segments testid="letters" label="Letter keys" options={LETTERS} value={letters ? "on" : "off"} onPick={(v) => update({ letterKeys: v === "on" })} /></div>
      <div class="choice"><span>Theme</span><Segments testid="theme" label="Theme" options={THEMES} value={theme} onPick={pick} /></div>
    </aside>
  );
}
