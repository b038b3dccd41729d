// Staged edits: typed text per gain. Nothing is sent on typing; a field that reads as the live value is no edit.

import type { Changes } from "./design";
import { unitText } from "./format";
import type { GainRow } from "./protocol";

export type Texts = Record<string, string>;

export interface Staged {
  changes: Changes;
  problems: Record<string, string>;
}

export function parse(text: string): number {
  return text.trim() === "" ? NaN : Number(text.replace("−", "-").replace(",", "."));
}

export function stagedOf(texts: Texts, live: Record<string, number>, rows: GainRow[]): Staged {
  const staged: Staged = { changes: {}, problems: {} };
  for (const row of rows) {
    const text = texts[row.key];
    if (text === undefined) continue;
    const value = parse(text);
    if (!Number.isFinite(value)) staged.problems[row.key] = `${row.label}: '${text}' is not a number`;
    else if (value < row.minimum || value > row.maximum) {
      staged.problems[row.key] = `${row.label} ${text} is outside ${row.minimum} to ${row.maximum} ${unitText(row.unit)}`;
    } else if (value !== live[row.key]) staged.changes[row.key] = value;
  }
  return staged;
}

// "× 2.5" for weights that differ by factors, "+58 %" for gains.
export function changeText(from: number, to: number, factor: boolean): string {
  if (!Number.isFinite(from) || !Number.isFinite(to) || from === to) return "";
  if (from === 0) return "new";
  if (factor) return `× ${(to / from).toPrecision(2).replace(/\.?0+$/, "") || "0"}`;
  const percent = ((to - from) / Math.abs(from)) * 100;
  return `${percent < 0 ? "−" : "+"}${Math.abs(percent).toFixed(0)} %`;
}
