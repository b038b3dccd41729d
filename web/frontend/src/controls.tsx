// Keys, segmented switches and marks. A hold key fills for 0.8 s; releasing early cancels.

import type { ComponentChildren, JSX } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import type { Level } from "./protocol";

export const HOLD_MS = 800;

interface Press {
  pressing: boolean;
  down: () => void;
  up: () => void;
}

export function usePress(hold: boolean, action: () => void): Press {
  const [pressing, setPressing] = useState(false);
  const timer = useRef<number | null>(null);
  const latest = useRef(action);
  latest.current = action;
  const up = (): void => {
    if (timer.current !== null) clearTimeout(timer.current);
    timer.current = null;
    setPressing(false);
  };
  const down = (): void => {
    if (timer.current !== null) return;
    if (!hold) return latest.current();
    setPressing(true);
    timer.current = window.setTimeout(() => {
      up();
      latest.current();
    }, HOLD_MS);
  };
  useEffect(() => up, []);
  return { pressing, down, up };
}

interface KeyProps {
  testid: string;
  hold?: boolean;
  primary?: boolean;
  disabled?: boolean;
  title?: string | undefined;
  onAct: () => void;
  children: ComponentChildren;
}

// Pointer, Enter and Space all press; the key also works from the keyboard while held.
export function Key({ testid, hold = false, primary = false, disabled = false, title, onAct, children }: KeyProps): JSX.Element {
  const { pressing, down, up } = usePress(hold, onAct);
  const names = ["key", hold && "hold", primary && "primary", pressing && "pressing"].filter(Boolean).join(" ");
  const keyed = (event: KeyboardEvent): boolean => event.key === "Enter" || event.key === " ";
  return (
    <button
      type="button" class={names} data-testid={testid} disabled={disabled} title={title}
      onPointerDown={(e) => hold && e.button === 0 && down()} onPointerUp={() => hold && up()} onPointerLeave={() => hold && up()}
      onKeyDown={(e) => { if (hold && keyed(e) && !e.repeat) { e.preventDefault(); down(); } }}
      onKeyUp={(e) => { if (hold && keyed(e)) up(); }}
      onBlur={() => hold && up()} onClick={() => !hold && onAct()}
    >
      {hold && <span class="fill" />}
      {typeof children === "string" ? <span>{children}</span> : children}
    </button>
  );
}

interface SegmentProps<T extends string> {
  testid: string;
  label: string;
  options: readonly { value: T; text: string }[];
  value: T | null;
  hold?: boolean;
  disabled?: boolean;
  onPick: (value: T) => void;
}

export function Segments<T extends string>(props: SegmentProps<T>): JSX.Element {
  return (
    <span class="segments" role="group" aria-label={props.label} data-testid={props.testid}>
      {props.options.map((option) => (
        <Segment
          key={option.value} testid={`${props.testid}-${option.value}`} text={option.text} on={option.value === props.value}
          hold={(props.hold ?? false) && option.value !== props.value} disabled={props.disabled ?? false} onPick={() => props.onPick(option.value)}
        />
      ))}
    </span>
  );
}

interface OneSegmentProps {
  testid: string;
  text: string;
  on: boolean;
  hold: boolean;
  disabled: boolean;
  onPick: () => void;
}

function Segment({ testid, text, on, hold, disabled, onPick }: OneSegmentProps): JSX.Element {
  const { pressing, down, up } = usePress(hold, onPick);
  const keyed = (event: KeyboardEvent): boolean => event.key === "Enter" || event.key === " ";
  return (
    <button
      type="button" data-testid={testid} aria-pressed={on} disabled={disabled} class={pressing ? "pressing" : ""}
      onPointerDown={(e) => hold && e.button === 0 && down()} onPointerUp={() => hold && up()} onPointerLeave={() => hold && up()}
      onKeyDown={(e) => { if (hold && keyed(e) && !e.repeat) { e.preventDefault(); down(); } }}
      onKeyUp={(e) => { if (hold && keyed(e)) up(); }} onClick={() => !hold && !on && onPick()}
    >
      {hold && <span class="fill" />}
      {text}
    </button>
  );
}

export function Mark({ level, cleared = false }: { level: Level; cleared?: boolean }): JSX.Element {
  const shape = {
    warning: <rect x="1.5" y="1.5" width="9" height="9" />,
    caution: <path d="M6 1.2 11.2 10.6H.8zM6 4.6v3M6 8.6v.7" />,
    advisory: <circle cx="6" cy="6" r="2.8" />,
  }[level];
  return (
    <svg class={`mark ${level}${cleared ? " cleared" : ""}`} viewBox="0 0 12 12" role="img" aria-label={level}>
      {shape}
    </svg>
  );
}

// "q_phi" as q with a lowered phi; Greek spelled out in the table of gains becomes the letter.
const GREEK: Record<string, string> = { phi: "φ", theta: "θ", psi: "ψ", zeta: "ζ", xi: "ξ" };

export function Symbol({ text }: { text: string }): JSX.Element {
  const [stem = "", ...rest] = text.split("_");
  const low = rest.join(",");
  const letter = (word: string): string => GREEK[word] ?? word;
  return (
    <span class="symbol">
      {letter(stem)}
      {low && <sub>{low.split(",").map(letter).join(" ")}</sub>}
    </span>
  );
}
